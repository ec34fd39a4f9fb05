//! What the examples on real recordings share: command line, arrays of numbers, figures, pictures.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde::Serialize;

/// How an example was called.
#[derive(Debug)]
pub(crate) struct Call {
    /// Where the recording is.
    pub(crate) folder: PathBuf,
    /// Where the picture goes.
    pub(crate) picture: PathBuf,
    json: bool,
}

impl Call {
    /// Reads `[FOLDER] [--picture FILE] [--json]`.
    ///
    /// # Errors
    /// If an argument is none of these.
    pub(crate) fn from_command_line(folder: &str, picture: &str) -> anyhow::Result<Self> {
        let mut call = Self { folder: folder.into(), picture: picture.into(), json: false };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--json" => call.json = true,
                "--picture" => {
                    call.picture = arguments.next().context("--picture needs a file")?.into();
                }
                flag if flag.starts_with('-') => {
                    bail!("unknown argument {flag}: use [FOLDER] [--picture FILE] [--json]")
                }
                path => call.folder = path.into(),
            }
        }
        Ok(call)
    }

    /// Writes the picture, then the figures to standard output: as JSON, or one in each line.
    ///
    /// # Errors
    /// If one of them cannot be written.
    pub(crate) fn finish(&self, figures: &impl Serialize, picture: &[u8]) -> anyhow::Result<()> {
        std::fs::write(&self.picture, picture)
            .with_context(|| format!("writing {}", self.picture.display()))?;
        let mut output = std::io::stdout().lock();
        let figures = serde_json::to_value(figures)?;
        if self.json {
            writeln!(output, "{figures}")?;
            return Ok(());
        }
        for (name, value) in figures.as_object().into_iter().flatten() {
            writeln!(output, "{name}: {value}")?;
        }
        writeln!(output, "picture: {}", self.picture.display())?;
        Ok(())
    }
}

/// A numpy array: its shape and all numbers, the last index fastest.
///
/// # Errors
/// Names the file that is absent or holds something else.
pub(crate) fn read_array<T: npyz::Deserialize>(
    path: &Path,
) -> anyhow::Result<(Vec<usize>, Vec<T>)> {
    let absent =
        || format!("{}: no such recording; give its folder as first argument", path.display());
    let bytes = std::fs::read(path).with_context(absent)?;
    let array = npyz::NpyFile::new(&bytes[..]).with_context(|| path.display().to_string())?;
    let shape = array.shape().iter().map(|n| usize::try_from(*n)).collect::<Result<_, _>>()?;
    let numbers = array.into_vec().with_context(|| path.display().to_string())?;
    Ok((shape, numbers))
}

/// The nearest single-precision number.
#[expect(clippy::cast_possible_truncation, reason = "24 bits are more than a receiver has")]
#[must_use]
pub(crate) fn single(value: f64) -> f32 {
    value as f32
}
