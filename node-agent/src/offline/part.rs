//! Files that have their name only when they are whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file that is `NAME.part` until it is whole. What is no regular file, `/dev/null` for example, is
/// written as it is.
#[derive(Clone, Debug)]
pub(super) struct PartName {
    part: PathBuf,
    path: PathBuf,
}

impl PartName {
    /// The name of the file that will be `path`.
    pub(super) fn of(path: &Path) -> Self {
        let is_special = std::fs::metadata(path).is_ok_and(|about| !about.is_file());
        let part = if is_special {
            path.to_owned()
        } else {
            let mut name = path.as_os_str().to_owned();
            name.push(".part");
            PathBuf::from(name)
        };
        Self { part, path: path.to_owned() }
    }

    /// Creates the file.
    pub(super) fn create(&self) -> io::Result<BufWriter<File>> {
        Ok(BufWriter::new(File::create(&self.part)?))
    }

    /// The file is whole.
    pub(super) fn keep(&self) -> io::Result<()> {
        if self.is_special() { Ok(()) } else { std::fs::rename(&self.part, &self.path) }
    }

    /// The file is of no use.
    pub(super) fn remove(&self) -> io::Result<()> {
        if self.is_special() { Ok(()) } else { std::fs::remove_file(&self.part) }
    }

    fn is_special(&self) -> bool {
        self.part == self.path
    }
}

/// Such a file, open.
#[derive(Debug)]
pub(super) struct PartFile {
    name: PartName,
    output: BufWriter<File>,
    is_empty: bool,
}

impl PartFile {
    /// Opens the file that will be `path`.
    pub(super) fn create(path: &Path) -> io::Result<Self> {
        let name = PartName::of(path);
        let output = name.create()?;
        Ok(Self { name, output, is_empty: true })
    }

    /// Gives the file its name.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.output.flush()?;
        self.name.keep()
    }

    /// Leaves what was written as a part; nothing, if that is nothing.
    pub(super) fn abandon(&mut self) -> io::Result<()> {
        self.output.flush()?;
        if self.is_empty { self.name.remove() } else { Ok(()) }
    }
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.is_empty = false;
        self.output.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_its_name_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let part = folder.path().join("a.csv.part");
        let mut file = PartFile::create(&path).unwrap();
        file.write_all(b"x").unwrap();
        assert!(part.exists() && !path.exists());
        file.finish().unwrap();
        assert!(!part.exists());
        assert_eq!(std::fs::read(&path).unwrap(), b"x");
        let mut broken = PartFile::create(&path).unwrap();
        broken.write_all(b"y").unwrap();
        broken.abandon().unwrap();
        assert_eq!(std::fs::read(&part).unwrap(), b"y");
        PartFile::create(&path).unwrap().abandon().unwrap();
        assert!(!part.exists(), "nothing is left of nothing");
        assert_eq!(std::fs::read(&path).unwrap(), b"x", "what was there before stays");
    }
}
