//! Pixels for the plotting library, so that one drawing routine makes SVG and PNG.

use std::convert::Infallible;

use embedded_graphics::mono_font::ascii::{FONT_7X13, FONT_9X15_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{
    Dimensions, DrawTarget, Drawable, Pixel as Dot, Point as Pixel, RgbColor,
};
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform,
};

use super::canvas::Canvas;

/// Texts of at least this size are titles.
const TITLE_SIZE: f64 = 17.0;

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// Draws on a canvas of `size` pixels. Knows ASCII in two sizes, along the axes.
#[derive(Debug)]
pub(crate) struct Raster<'a> {
    canvas: &'a mut Canvas,
    size: (u32, u32),
}

impl<'a> Raster<'a> {
    /// Draws on `canvas`, which must be of `size`: width and height.
    #[must_use]
    pub(crate) fn new(canvas: &'a mut Canvas, size: (u32, u32)) -> Self {
        Self { canvas, size }
    }
}

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Drawn {
        let at = Pixel::new(x, y);
        if let Some(under) = self.canvas.get(at) {
            let (r, g, b) = color.rgb;
            let mixed = Rgb888::new(
                mix(under.r(), r, color.alpha),
                mix(under.g(), g, color.alpha),
                mix(under.b(), b, color.alpha),
            );
            self.canvas.set(at, mixed);
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> Drawn {
        let alignment = match style.anchor().h_pos {
            HPos::Left => Alignment::Left,
            HPos::Center => Alignment::Center,
            HPos::Right => Alignment::Right,
        };
        let baseline = match style.anchor().v_pos {
            VPos::Top => Baseline::Top,
            VPos::Center => Baseline::Middle,
            VPos::Bottom => Baseline::Bottom,
        };
        let (r, g, b) = style.color().rgb;
        let letters = MonoTextStyle::new(font(style.size()), Rgb888::new(r, g, b));
        let layout = TextStyleBuilder::new().alignment(alignment).baseline(baseline).build();
        // About its own origin, which is then laid where the text belongs.
        let writing = Text::with_text_style(text, Pixel::zero(), letters, layout);
        let mut page = Page { canvas: self.canvas, at: Pixel::new(x, y), turn: style.transform() };
        let Ok(_end) = writing.draw(&mut page);
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let letter = font(style.size()).character_size;
        let count = u32::try_from(text.chars().count()).unwrap_or(u32::MAX);
        Ok((letter.width.saturating_mul(count), letter.height))
    }
}

/// A canvas on which a text lies turned.
struct Page<'a> {
    canvas: &'a mut Canvas,
    at: Pixel,
    turn: FontTransform,
}

impl Dimensions for Page<'_> {
    fn bounding_box(&self) -> Rectangle {
        self.canvas.bounding_box()
    }
}

impl DrawTarget for Page<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Dot<Rgb888>>>(
        &mut self,
        dots: I,
    ) -> Result<(), Infallible> {
        for Dot(from, color) in dots {
            let turned = match self.turn {
                FontTransform::None => from,
                FontTransform::Rotate90 => Pixel::new(-from.y, from.x),
                FontTransform::Rotate180 => Pixel::new(-from.x, -from.y),
                FontTransform::Rotate270 => Pixel::new(from.y, -from.x),
            };
            self.canvas.set(self.at + turned, color);
        }
        Ok(())
    }
}

fn font(size: f64) -> &'static MonoFont<'static> {
    if size < TITLE_SIZE { &FONT_7X13 } else { &FONT_9X15_BOLD }
}

/// `over` laid on `under` with the given opacity.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
fn mix(under: u8, over: u8, opacity: f64) -> u8 {
    let share = opacity.clamp(0.0, 1.0);
    (f64::from(under) * (1.0 - share) + f64::from(over) * share).round() as u8
}

#[cfg(test)]
mod tests {
    use plotters::prelude::{IntoDrawingArea, IntoFont, TextStyle};

    use super::*;

    /// Rows and columns between the first and the last that has ink.
    fn inked(turn: FontTransform) -> (usize, usize) {
        let mut canvas = Canvas::new(101, 101);
        let area = Raster::new(&mut canvas, (101, 101)).into_drawing_area();
        area.fill(&plotters::style::WHITE).unwrap();
        let style = TextStyle::from(("sans-serif", 12).into_font().transform(turn));
        area.draw_text("north", &style, (50, 50)).unwrap();
        drop(area);
        let dark = canvas.rgb().chunks(3).enumerate().filter(|(_, pixel)| pixel[0] < 128);
        let places: Vec<(usize, usize)> = dark.map(|(at, _)| (at % 101, at / 101)).collect();
        let span = |of: fn(&(usize, usize)) -> usize| {
            places.iter().map(of).max().unwrap() - places.iter().map(of).min().unwrap()
        };
        (span(|at| at.0), span(|at| at.1))
    }

    #[test]
    fn a_turned_text_is_as_high_as_it_was_wide() {
        let (width, height) = inked(FontTransform::None);
        assert!(2 * height < width, "{width} {height}");
        assert_eq!(inked(FontTransform::Rotate270), (height, width));
        assert_eq!(inked(FontTransform::Rotate180), (width, height));
    }
}
