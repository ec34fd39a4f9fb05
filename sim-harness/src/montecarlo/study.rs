//! What all experiments are to a command: flags in; a table, a document and pictures out.

use std::path::Path;

use tokio_util::sync::CancellationToken;

/// An experiment that can be asked for.
pub(crate) trait Study: Sized {
    /// What is to be said of it.
    type Flags;
    /// What comes out.
    type Report: Results;

    /// The experiment that the flags ask for.
    ///
    /// # Errors
    /// Says what makes no sense and what would do.
    fn new(flags: &Self::Flags) -> anyhow::Result<Self>;

    /// A short name for folders.
    fn name(&self) -> String;

    /// Carries all trials out.
    ///
    /// # Errors
    /// If one cannot be carried out, or `stop` was called.
    fn run(&self, stop: &CancellationToken) -> anyhow::Result<Self::Report>;
}

/// What an experiment has shown.
pub(crate) trait Results {
    /// The tables, with what the columns mean and the bars.
    fn table(&self) -> String;

    /// The document: everything and the bars.
    ///
    /// # Errors
    /// If a number cannot be written as JSON.
    fn json(&self) -> anyhow::Result<String>;

    /// Writes `montecarlo.json` and the pictures, as SVG and as PNG, into the folder.
    ///
    /// # Errors
    /// If they cannot be drawn or written.
    fn write(&self, folder: &Path) -> anyhow::Result<()>;
}

/// Carries an experiment out and leaves its results in `folder`.
///
/// # Errors
/// If it cannot be carried out, was stopped, or a file cannot be written.
pub(crate) fn carry_out<S: Study>(
    study: &S,
    folder: &Path,
    stop: &CancellationToken,
) -> anyhow::Result<S::Report> {
    let report = study.run(stop)?;
    report.write(folder)?;
    Ok(report)
}

#[cfg(test)]
pub(super) mod words {
    //! Experiments by the words of a command line, for their tests.

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line<F: clap::Args> {
        #[command(flatten)]
        flags: F,
    }

    /// The experiment that these words ask for.
    pub(crate) fn asked<S: Study<Flags: clap::Args>>(words: &str) -> anyhow::Result<S> {
        let words = std::iter::once("montecarlo").chain(words.split_whitespace());
        S::new(&Line::<S::Flags>::try_parse_from(words)?.flags)
    }

    /// What it shows.
    pub(crate) fn reported<S: Study<Flags: clap::Args>>(words: &str) -> S::Report {
        asked::<S>(words).unwrap().run(&CancellationToken::new()).unwrap()
    }
}
