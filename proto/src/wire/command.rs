//! What an operator may ask of the centre.

use serde::{Deserialize, Serialize};

use super::check::Invalid;
use super::codec::Message;
use super::header::Kind;
use crate::ids::NodeId;

/// An operator's request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Forget what was seen so far and register anew: this node, or every node if none is named.
    /// The transforms in force stay until better ones are found.
    Recalibrate {
        /// Which node.
        node: Option<NodeId>,
    },
}

impl Message for Command {
    const KIND: Kind = Kind::Command;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 1 << 10;

    fn check(&self) -> Result<(), Invalid> {
        Ok(())
    }
}
