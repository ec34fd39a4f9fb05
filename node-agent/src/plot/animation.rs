//! Pictures one after another as one file: animated PNG, or GIF with a palette of the picture's own.

use std::collections::HashMap;
use std::io::{self, Write};

use embedded_graphics::prelude::RgbColor;

use super::followed::{COLORS, TENTATIVE_COLOR};
use super::{POINT_COLOR, shade};
use chart::canvas::Canvas;

/// Shades of the image in the palette of a GIF, which has room for 256 colours with those of lines
/// and letters.
const SHADE_COUNT: u8 = 240;

/// The formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnimationKind {
    /// Animated PNG: all colours.
    Png,
    /// GIF: 256 colours, smaller, and shown by everything.
    Gif,
}

/// What must be known before the first frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnimationShape {
    /// Width and height of every frame, pixels, below 65536.
    pub pixels: (u16, u16),
    /// Frames that will come.
    pub frame_count: u32,
    /// Time from one to the next, milliseconds.
    pub delay_ms: u16,
}

/// An animation that is written frame by frame and repeats without end.
pub struct Animation<W: Write> {
    encoder: Encoder<W>,
    shape: AnimationShape,
}

enum Encoder<W: Write> {
    Png(Box<png::Writer<W>>),
    Gif(Box<gif::Encoder<W>>, Box<Palette>),
}

impl<W: Write> Animation<W> {
    /// Writes what stands before the first frame.
    ///
    /// # Errors
    /// If it cannot be written, or no frame will come.
    pub fn begin(kind: AnimationKind, output: W, shape: AnimationShape) -> io::Result<Self> {
        let encoder = match kind {
            AnimationKind::Png => Encoder::Png(Box::new(begin_png(output, shape)?)),
            AnimationKind::Gif => {
                let (palette, (width, height)) = (Palette::new(), shape.pixels);
                let begun = gif::Encoder::new(output, width, height, &palette.bytes());
                let mut encoder = begun.map_err(io::Error::other)?;
                encoder.set_repeat(gif::Repeat::Infinite).map_err(io::Error::other)?;
                Encoder::Gif(Box::new(encoder), Box::new(palette))
            }
        };
        Ok(Self { encoder, shape })
    }

    /// Writes the next frame.
    ///
    /// # Errors
    /// If it cannot be written, has another size, or is one too many.
    pub fn add(&mut self, canvas: &Canvas) -> io::Result<()> {
        let (width, height) = self.shape.pixels;
        if canvas.pixels() != (u32::from(width), u32::from(height)) {
            let what = format!("a frame of {:?} pixels in an animation", canvas.pixels());
            return Err(io::Error::other(format!("{what} of {width} by {height}")));
        }
        match &mut self.encoder {
            Encoder::Png(writer) => Ok(writer.write_image_data(canvas.rgb())?),
            Encoder::Gif(encoder, palette) => {
                let indices = palette.indices(canvas.rgb());
                let mut frame = gif::Frame::from_indexed_pixels(width, height, indices, None);
                // In hundredths of a second; below two, viewers take ten.
                frame.delay = (self.shape.delay_ms / 10).max(2);
                encoder.write_frame(&frame).map_err(io::Error::other)
            }
        }
    }

    /// Writes what stands behind the last frame.
    ///
    /// # Errors
    /// If it cannot be written, or frames are missing.
    pub fn finish(self) -> io::Result<()> {
        match self.encoder {
            Encoder::Png(writer) => Ok(writer.finish()?),
            Encoder::Gif(encoder, _) => encoder.into_inner().map_err(io::Error::other)?.flush(),
        }
    }
}

fn begin_png<W: Write>(output: W, shape: AnimationShape) -> io::Result<png::Writer<W>> {
    let (width, height) = shape.pixels;
    let mut encoder = png::Encoder::new(output, u32::from(width), u32::from(height));
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_animated(shape.frame_count, 0)?;
    encoder.set_frame_delay(shape.delay_ms, 1000)?;
    // Without this, frames too many or too few would go unnoticed.
    encoder.validate_sequence(true);
    Ok(encoder.write_header()?)
}

/// Up to 256 colours, and which of them is nearest to any other.
struct Palette {
    colors: Vec<[u8; 3]>,
    nearest: HashMap<[u8; 3], u8>,
}

impl Palette {
    fn new() -> Self {
        let shades =
            (0..SHADE_COUNT).map(|index| shade(f64::from(index) / f64::from(SHADE_COUNT - 1)));
        let lines = COLORS.into_iter().chain([TENTATIVE_COLOR, POINT_COLOR]);
        let white_and_black = [RgbColor::WHITE, RgbColor::BLACK];
        let all = shades.chain(lines).chain(white_and_black);
        let colors = all.map(|color| [color.r(), color.g(), color.b()]).collect();
        Self { colors, nearest: HashMap::new() }
    }

    fn bytes(&self) -> Vec<u8> {
        self.colors.iter().flatten().copied().collect()
    }

    fn indices(&mut self, rgb: &[u8]) -> Vec<u8> {
        let Self { colors, nearest } = self;
        let pixels = rgb.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]);
        pixels
            .map(|pixel| *nearest.entry(pixel).or_insert_with(|| closest(colors, pixel)))
            .collect()
    }
}

/// Which of at most 256 colours is closest to `pixel`.
fn closest(colors: &[[u8; 3]], pixel: [u8; 3]) -> u8 {
    let away = |color: &[u8; 3]| -> u32 {
        color.iter().zip(pixel).map(|(one, other)| u32::from(one.abs_diff(other)).pow(2)).sum()
    };
    let numbered = (0..=u8::MAX).zip(colors);
    numbered.min_by_key(|(_, color)| away(color)).map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use embedded_graphics::pixelcolor::Rgb888;
    use embedded_graphics::prelude::Point as Pixel;

    use super::*;

    const SHAPE: AnimationShape =
        AnimationShape { pixels: (40, 30), frame_count: 3, delay_ms: 120 };
    /// Largest difference of a channel between a shade and the nearest of 240: a fifth of the steps
    /// of the scale's steepest channel.
    const SHADE_TOLERANCE: u8 = 3;

    /// A shade and a line that wander from frame to frame.
    fn frame(number: i32) -> Canvas {
        let mut canvas = Canvas::new(40, 30);
        for x in 0..40 {
            for y in 0..30 {
                canvas.set(Pixel::new(x, y), shade(f64::from((x + number) * 29 + y) / 1300.0));
            }
        }
        canvas.line(Pixel::new(number, 0), Pixel::new(number, 29), COLORS[2]);
        canvas
    }

    fn written(kind: AnimationKind) -> Vec<u8> {
        let mut file = Vec::new();
        let mut animation = Animation::begin(kind, &mut file, SHAPE).unwrap();
        (0..3).for_each(|number| animation.add(&frame(number)).unwrap());
        animation.finish().unwrap();
        file
    }

    #[test]
    fn an_animated_png_holds_every_frame_as_drawn() {
        let decoder = png::Decoder::new(Cursor::new(written(AnimationKind::Png)));
        let mut reader = decoder.read_info().unwrap();
        let control = *reader.info().animation_control().unwrap();
        assert_eq!((control.num_frames, control.num_plays), (3, 0));
        for number in 0..3 {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(pixels, frame(number).rgb(), "frame {number}");
            let timing = reader.info().frame_control().unwrap();
            assert_eq!((timing.delay_num, timing.delay_den), (120, 1000));
        }
    }

    #[test]
    fn a_gif_holds_every_frame_but_for_the_palette() {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(Cursor::new(written(AnimationKind::Gif))).unwrap();
        for number in 0..3 {
            let read = reader.read_next_frame().unwrap().unwrap();
            assert_eq!(read.delay, 12);
            let drawn = frame(number);
            let pixels = read.buffer.chunks_exact(4).zip(drawn.rgb().chunks_exact(3));
            for (index, (got, want)) in pixels.enumerate() {
                let off = got.iter().zip(want).map(|(g, w)| g.abs_diff(*w)).max().unwrap();
                assert!(off <= SHADE_TOLERANCE, "frame {number}, pixel {index}: {got:?} {want:?}");
            }
            let line = COLORS[2];
            let at = 4 * usize::try_from(number).unwrap();
            assert_eq!(read.buffer[at..at + 3], [line.r(), line.g(), line.b()]);
        }
        assert!(reader.read_next_frame().unwrap().is_none());
    }

    #[test]
    fn missing_surplus_and_wrong_frames_are_errors() {
        let begin = || Animation::begin(AnimationKind::Png, Vec::new(), SHAPE).unwrap();
        assert!(begin().finish().is_err());
        let mut full = begin();
        (0..3).for_each(|number| full.add(&frame(number)).unwrap());
        assert!(full.add(&frame(3)).is_err());
        let mut other = Canvas::new(41, 30);
        other.set(Pixel::new(0, 0), Rgb888::new(1, 2, 3));
        assert!(begin().add(&other).unwrap_err().to_string().contains("41, 30"));
        let none = AnimationShape { frame_count: 0, ..SHAPE };
        assert!(Animation::begin(AnimationKind::Png, Vec::new(), none).is_err());
    }
}
