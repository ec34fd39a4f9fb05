//! Pixels in memory, to draw lines and text on and write as PNG.

use std::convert::Infallible;
use std::io::Write;

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{
    DrawTarget, Drawable, OriginDimensions, Pixel as Dot, Point as Pixel, Primitive, RgbColor, Size,
};
use embedded_graphics::primitives::{Line, PrimitiveStyle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};

/// Which part of a text lies at the given place.
#[derive(Clone, Copy, Debug)]
pub enum Anchor {
    /// Its left end.
    Left,
    /// Its middle.
    Middle,
    /// Its right end.
    Right,
}

/// Pixels of red, green and blue, row by row from the top.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: u32,
    height: u32,
    rgb: Vec<u8>,
}

impl Canvas {
    /// A black canvas.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![0; 3 * width as usize * height as usize] }
    }

    /// Colours one pixel; outside the canvas nothing happens.
    pub fn set(&mut self, at: Pixel, color: Rgb888) {
        if let Some(index) = self.index(at) {
            self.rgb[index..index + 3].copy_from_slice(&[color.r(), color.g(), color.b()]);
        }
    }

    /// The colour of a pixel; `None` outside the canvas.
    #[must_use]
    pub fn get(&self, at: Pixel) -> Option<Rgb888> {
        let index = self.index(at)?;
        Some(Rgb888::new(self.rgb[index], self.rgb[index + 1], self.rgb[index + 2]))
    }

    /// Where a pixel's three bytes begin.
    fn index(&self, at: Pixel) -> Option<usize> {
        let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y)) else { return None };
        let is_inside = x < self.width && y < self.height;
        is_inside.then_some(3 * (y as usize * self.width as usize + x as usize))
    }

    /// Draws a line one pixel wide.
    pub fn line(&mut self, from: Pixel, to: Pixel, color: Rgb888) {
        let line = Line::new(from, to).into_styled(PrimitiveStyle::with_stroke(color, 1));
        let Ok(()) = line.draw(self);
    }

    /// Writes white text whose vertical middle is at `at`.
    pub fn text(&mut self, text: &str, at: Pixel, anchor: Anchor) {
        let alignment = match anchor {
            Anchor::Left => Alignment::Left,
            Anchor::Middle => Alignment::Center,
            Anchor::Right => Alignment::Right,
        };
        let style = TextStyleBuilder::new().alignment(alignment).baseline(Baseline::Middle).build();
        let font = MonoTextStyle::new(&FONT_7X13, Rgb888::WHITE);
        let Ok(_end) = Text::with_text_style(text, at, font, style).draw(self);
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn pixels(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Red, green and blue of every pixel, row by row from the top.
    #[must_use]
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Writes the canvas as PNG.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_png(&self, output: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(output, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Dot<Rgb888>>>(
        &mut self,
        dots: I,
    ) -> Result<(), Infallible> {
        for Dot(at, color) in dots {
            self.set(at, color);
        }
        Ok(())
    }
}
