//! The state file: read at the start, replaced as a whole, so that it is never seen half written.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

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

/// Makes sure that the file can be written, before anything rests on it.
///
/// # Errors
/// If it cannot, with what would help.
pub(super) fn check_writable(path: &Path) -> anyhow::Result<()> {
    let named = || format!("state.path = \"{}\"", path.display());
    ensure!(!path.is_dir(), "{} is a folder: name a file in it", named());
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let is_there = folder.is_none_or(Path::is_dir);
    ensure!(is_there, "{}: its folder is missing: create it, or name another file", named());
    let beside = beside(path);
    File::create(&beside).and_then(|_| std::fs::remove_file(&beside)).with_context(|| {
        format!("{}: nothing can be written beside it: allow it, or name another file", named())
    })
}

/// Where a new file is written before it replaces the old one.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    name.into()
}

/// Replaces the file: written beside it, forced to the disk, renamed over it.
///
/// # Errors
/// If it cannot be written.
pub(super) fn write(path: &Path, text: &str) -> std::io::Result<()> {
    let beside = beside(path);
    let mut file = File::create(&beside)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    std::fs::rename(&beside, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_replaces_what_was_there() {
        let folder = std::env::temp_dir().join(format!("state-{}", proto::ids::BootId::random()));
        std::fs::create_dir(&folder).unwrap();
        let path = folder.join("state.toml");
        assert!(read(&path).unwrap().is_none());
        for text in ["a longer first text", "second"] {
            write(&path, text).unwrap();
            assert_eq!(read(&path).unwrap().as_deref(), Some(text));
        }
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "nothing is left beside it");
        assert!(write(&folder.join("none").join("state.toml"), "x").is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_cannot_be_written_is_refused_with_what_helps() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state.toml");
        check_writable(&file).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left");
        let complaint = |path: &Path| format!("{:#}", check_writable(path).unwrap_err());
        assert!(complaint(folder.path()).contains("is a folder: name a file in it"));
        let missing = complaint(&folder.path().join("none").join("state.toml"));
        assert!(missing.contains("none/state.toml") && missing.contains("create it"), "{missing}");
        // A folder in the place of the file beside it: permissions do not bind the super-user.
        std::fs::create_dir(folder.path().join("state.toml.new")).unwrap();
        assert!(complaint(&file).contains("nothing can be written beside it"));
    }
}
