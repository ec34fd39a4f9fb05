//! The state file, read at the start.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, ensure};

/// Longest state file that is read, bytes: 256 nodes need a tenth of it.
const MAX_BYTES: u64 = 4 << 20;

/// The text of the file; `None` if there is none yet.
///
/// # Errors
/// If it cannot be read.
pub(super) fn read(path: &Path) -> anyhow::Result<Option<String>> {
    let length = match std::fs::metadata(path) {
        Ok(found) => found.len(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error).context(format!("state file {}", path.display())),
    };
    ensure!(
        length <= MAX_BYTES,
        "state file {}: {length} bytes, more than a centre writes; name another in state.path",
        path.display()
    );
    let text = std::fs::read_to_string(path);
    text.map(Some).with_context(|| format!("state file {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replace::write;

    #[test]
    fn what_is_written_is_read_and_replaces_what_was_there() {
        let folder = std::env::temp_dir().join(format!("state-{}", proto::ids::BootId::random()));
        std::fs::create_dir(&folder).unwrap();
        let path = folder.join("state.toml");
        assert!(read(&path).unwrap().is_none());
        for text in ["a longer first text", "second"] {
            write(&path, text.as_bytes()).unwrap();
            assert_eq!(read(&path).unwrap().as_deref(), Some(text));
        }
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "nothing is left beside it");
        assert!(write(&folder.join("none").join("state.toml"), b"x").is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
