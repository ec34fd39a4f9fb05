//! Files that are replaced as a whole, so that they are never seen half written.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

/// Makes sure that the file, which the user named as `name`, can be written, before anything rests on it.
///
/// # Errors
/// If it cannot, with what would help.
pub(crate) fn check_writable(name: &str, path: &Path) -> anyhow::Result<()> {
    let named = || format!("{name} = \"{}\"", path.display());
    ensure!(!path.is_dir(), "{} is a folder: name a file in it", named());
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let is_there = folder.is_none_or(Path::is_dir);
    ensure!(is_there, "{}: its folder is missing: create it, or name another file", named());
    if is_special(path) {
        return Ok(());
    }
    let beside = beside(&followed(path));
    File::create(&beside).and_then(|_| std::fs::remove_file(&beside)).with_context(|| {
        format!("{}: nothing can be written beside it: allow it, or name another file", named())
    })
}

/// Replaces the file so that a loss of power leaves the old or the new one: written beside it, forced to
/// the disk, renamed over it. What is no file, such as a pipe, is written to.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    put(path, bytes, File::sync_all)
}

/// Replaces the file so that no reader sees it half written. A disk that is busy delays nobody: what is
/// written every few seconds may be lost with the power.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn show(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    put(path, bytes, |_| Ok(()))
}

fn put(
    path: &Path,
    bytes: &[u8],
    settle: impl FnOnce(&File) -> std::io::Result<()>,
) -> std::io::Result<()> {
    if is_special(path) {
        return std::fs::write(path, bytes);
    }
    let path = followed(path);
    let beside = beside(&path);
    let mut file = File::create(&beside)?;
    let written = file.write_all(bytes).and_then(|()| settle(&file));
    let replaced = written.and_then(|()| std::fs::rename(&beside, &path));
    if replaced.is_err() {
        // What is half written is of no use; that it could not be written is told all the same.
        drop(std::fs::remove_file(&beside));
    }
    replaced
}

/// Where a new file is written before it replaces the old one.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    name.into()
}

/// A device, pipe or socket.
fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// The file itself, where the path is a link to it.
fn followed(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_replaces_what_was_there_also_behind_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.kml");
        let link = folder.path().join("link.kml");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        for (to, text) in [(&path, "a longer first text"), (&link, "second")] {
            for put in [write, show] {
                put(to, text.as_bytes()).unwrap();
                assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
                std::fs::write(&path, "other").unwrap();
            }
        }
        assert!(link.is_symlink());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left");
        assert!(write(&folder.path().join("none").join("x"), b"x").is_err());
    }

    #[test]
    fn devices_are_written_to_and_not_replaced() {
        check_writable("--kml", Path::new("/dev/null")).unwrap();
        write(Path::new("/dev/null"), b"x").unwrap();
        assert!(is_special(Path::new("/dev/null")));
    }

    #[test]
    fn what_cannot_be_written_is_refused_with_what_helps() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("t.kml");
        check_writable("--kml", &file).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left");
        let complaint = |path: &Path| format!("{:#}", check_writable("--kml", path).unwrap_err());
        let taken = complaint(folder.path());
        assert!(taken.starts_with("--kml = ") && taken.contains("is a folder: name a file in it"));
        let missing = complaint(&folder.path().join("none").join("t.kml"));
        assert!(missing.contains("none/t.kml") && missing.contains("create it"), "{missing}");
        // A folder in the place of the file beside it: permissions do not bind the super-user.
        std::fs::create_dir(folder.path().join("t.kml.new")).unwrap();
        assert!(complaint(&file).contains("nothing can be written beside it"));
        assert!(write(&file, b"x").is_err());
    }
}
