//! The periods of a recording as an animation: images with the templates and ids of who is followed.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use proto::wire::TrackRecord;

use super::super::part::PartName;
use super::super::sink::{Beginning, Seen};
use crate::plot::{Animation, AnimationKind, AnimationShape, Picture, draw_tracks};

/// Most frames of an animation; of longer recordings every second period is shown, or every third,
/// and so on: ten minutes at ten periods a second are shown whole.
const MAX_FRAME_COUNT: u64 = 6000;

/// An animation on its way to a file.
pub(super) struct Video {
    kind: AnimationKind,
    name: PartName,
    title: String,
    beginning: Option<Beginning>,
    stride: u64,
    animation: Option<Animation<BufWriter<File>>>,
}

impl Video {
    /// An animation that will be `path`: animated PNG or GIF by its ending.
    pub(super) fn new(path: &Path, title: String) -> io::Result<Self> {
        let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
        let kind = match ending.as_deref().and_then(|ending| ending.to_str()) {
            Some("png" | "apng") => AnimationKind::Png,
            Some("gif") => AnimationKind::Gif,
            _ => {
                let what = format!("{}: use an ending .png or .gif", path.display());
                return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
            }
        };
        let name = PartName::of(path);
        Ok(Self { kind, name, title, beginning: None, stride: 1, animation: None })
    }

    /// Notes how many periods will come.
    pub(super) fn begin(&mut self, beginning: &Beginning) {
        self.beginning = Some(*beginning);
        self.stride = beginning.period_count.div_ceil(MAX_FRAME_COUNT).max(1);
    }

    /// Shows the next period, or leaves it out.
    pub(super) fn show(&mut self, seen: &Seen<'_>, tracks: &[TrackRecord]) -> io::Result<()> {
        let Some(beginning) = self.beginning else { return Ok(()) };
        if !seen.period.is_multiple_of(self.stride) {
            return Ok(());
        }
        let image = &seen.measured.image;
        let title = format!("{}, period {}, {:.2} s", self.title, seen.period, seen.time_s);
        let amplitude = &image.on_grid();
        let picture = Picture { title, grid: image.grid, amplitude, points: &[] };
        let mut canvas = picture.canvas();
        draw_tracks(&mut canvas, &image.grid, tracks);
        let animation = match &mut self.animation {
            Some(animation) => animation,
            none => {
                let shape = shape(canvas.pixels(), &beginning, self.stride)?;
                let output = self.name.create()?;
                none.insert(Animation::begin(self.kind, output, shape)?)
            }
        };
        animation.add(&canvas)
    }

    /// Gives the file its name; without a frame there is none.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        let Some(animation) = self.animation.take() else { return Ok(()) };
        animation.finish()?;
        self.name.keep()
    }

    /// Removes the file: an animation with frames missing is none.
    pub(super) fn abandon(&mut self) -> io::Result<()> {
        if self.animation.take().is_some() { self.name.remove() } else { Ok(()) }
    }
}

fn shape(
    (width, height): (u32, u32),
    beginning: &Beginning,
    stride: u64,
) -> io::Result<AnimationShape> {
    let small = |pixels: u32| u16::try_from(pixels).map_err(io::Error::other);
    let frame_count = beginning.period_count.div_ceil(stride);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before")]
    let delay_ms = (1e3 * beginning.period_s * stride as f64).round().clamp(10.0, 1e4) as u16;
    Ok(AnimationShape {
        pixels: (small(width)?, small(height)?),
        frame_count: u32::try_from(frame_count).map_err(io::Error::other)?,
        delay_ms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_recordings_are_thinned_and_keep_their_pace() {
        let mut video = Video::new(Path::new("a.gif"), String::new()).unwrap();
        let mut at = |period_count| {
            let beginning = Beginning { period_count, period_s: 0.1 };
            video.begin(&beginning);
            let AnimationShape { frame_count, delay_ms, .. } =
                shape((100, 50), &beginning, video.stride).unwrap();
            (video.stride, frame_count, delay_ms)
        };
        assert_eq!(at(6000), (1, 6000, 100));
        assert_eq!(at(12_001), (3, 4001, 300));
        assert!(shape((70_000, 50), &Beginning { period_count: 1, period_s: 0.1 }, 1).is_err());
    }

    #[test]
    fn an_unknown_ending_is_named_with_the_remedy() {
        let said = Video::new(Path::new("a.mp4"), String::new()).err().unwrap().to_string();
        assert!(said.contains("a.mp4") && said.contains(".gif"), "{said}");
    }
}
