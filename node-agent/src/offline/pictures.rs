//! The images of a recording as PNG files, several at a time.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use proto::measured::MeasuredPoint;
use rayon::prelude::*;

use crate::pipeline::Image;
use crate::plot::Picture;

/// Images that wait to be written together: bounds the memory.
const BATCH_COUNT: usize = 16;

/// One image to write.
struct Waiting {
    path: PathBuf,
    title: String,
    image: Image,
    points: Vec<MeasuredPoint>,
}

/// A folder of images.
pub(super) struct Pictures {
    folder: PathBuf,
    waiting: Vec<Waiting>,
}

impl Pictures {
    pub(super) fn create(folder: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        Ok(Self { folder: folder.to_owned(), waiting: Vec::with_capacity(BATCH_COUNT) })
    }

    /// Takes the image `NODE-PERIOD.png`.
    pub(super) fn take(
        &mut self,
        name: &str,
        title: String,
        image: Image,
        points: &[MeasuredPoint],
    ) -> io::Result<()> {
        let path = self.folder.join(format!("{name}.png"));
        self.waiting.push(Waiting { path, title, image, points: points.to_vec() });
        if self.waiting.len() < BATCH_COUNT { Ok(()) } else { self.finish() }
    }

    /// Writes all that wait.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        let written = self.waiting.par_iter().try_for_each(Waiting::write);
        self.waiting.clear();
        written
    }
}

impl Waiting {
    fn write(&self) -> io::Result<()> {
        let mut file = BufWriter::new(File::create(&self.path)?);
        let picture = Picture::of_image(self.title.clone(), &self.image, &self.points);
        picture.write_png(&mut file).map_err(io::Error::other)?;
        file.flush()
    }
}
