//! Checked identifiers: of nodes, of sites, and of one life of a process.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What stands for the centre where a node's name would stand; no node may be called so.
pub const CENTRE: &str = "centre";

/// Longest name of a node or a site, in bytes.
pub const MAX_NAME_LENGTH: usize = 32;

/// Why a text is not a name.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "{text:?} is not a name: use 1 to {MAX_NAME_LENGTH} of a-z, 0-9 and '-', starting with a letter or digit, other than \"centre\""
)]
pub struct InvalidName {
    /// The text as given, cut to a readable length.
    pub text: String,
}

fn checked_name(text: &str) -> Result<String, InvalidName> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let good = (1..=MAX_NAME_LENGTH).contains(&text.len())
        && text.chars().all(allowed)
        && !text.starts_with('-')
        && text != CENTRE;
    if good {
        Ok(text.to_owned())
    } else {
        Err(InvalidName { text: text.chars().take(40).collect() })
    }
}

macro_rules! name {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(try_from = "String", into = "String")]
        pub struct $name(String);

        impl $name {
            /// The name as text.
            #[must_use]
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl FromStr for $name {
            type Err = InvalidName;

            fn from_str(text: &str) -> Result<Self, InvalidName> {
                checked_name(text).map(Self)
            }
        }

        impl TryFrom<String> for $name {
            type Error = InvalidName;

            fn try_from(text: String) -> Result<Self, InvalidName> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(name: $name) -> Self {
                name.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(&self.0)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(self, f)
            }
        }
    };
}

name! {
    /// Which radar node: safe as one chunk of a key expression.
    NodeId
}
name! {
    /// Which installation: many sites can share one Zenoh network.
    SiteId
}

/// One life of a process: drawn at random when it starts, so that a restart is visible.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct BootId(pub u64);

impl BootId {
    /// A boot id from the operating system's randomness.
    #[must_use]
    pub fn random() -> Self {
        Self(rand::random())
    }
}

impl fmt::Display for BootId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl fmt::Debug for BootId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for BootId {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        u64::from_str_radix(text, 16).map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_one_safe_chunk_of_a_key() {
        for good in ["n1", "a", "north-wall-2", "0", &"x".repeat(MAX_NAME_LENGTH)] {
            assert!(good.parse::<NodeId>().is_ok(), "{good}");
        }
        let long = "x".repeat(MAX_NAME_LENGTH + 1);
        for bad in ["", "N1", "a/b", "*", "a b", "ä", "-a", "@x", "$*", CENTRE, long.as_str()] {
            let error = bad.parse::<NodeId>().unwrap_err();
            assert!(error.to_string().contains("a-z"), "{bad}: {error}");
        }
    }

    #[test]
    fn boot_ids_print_as_sixteen_digits_and_parse_back() {
        assert_eq!(BootId(0xab).to_string(), "00000000000000ab");
        assert_eq!("00000000000000ab".parse(), Ok(BootId(0xab)));
    }
}
