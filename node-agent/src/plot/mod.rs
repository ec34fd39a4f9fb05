//! A node's image as a picture for people: decibels in colour, axes in metres, points with their
//! two-sigma ellipses.

mod animation;
mod density;
mod followed;
mod paths;

use std::io::Write;

use chart::canvas::{Anchor, Canvas};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{Point as Pixel, RgbColor};
use proto::geom::{Gaussian, Node, principal_axes};
use proto::measured::MeasuredPoint;
use proto::radar::Grid;

pub use animation::{Animation, AnimationKind, AnimationShape};

pub use density::Density;
pub use followed::draw_tracks;
pub use paths::{Line, PathsFigure};

use crate::pipeline::Image;

/// Weakest shade, decibels of power below the strongest pixel.
const FLOOR_DB: f64 = -30.0;
/// Pixels of the picture's larger side within the axes.
const PLOT_PIXELS: u32 = 640;
const MARGIN_LEFT: i32 = 56;
const MARGIN_TOP: i32 = 28;
const MARGIN_BOTTOM: u32 = 44;
const MARGIN_RIGHT: u32 = 84;
const BAR_WIDTH: u32 = 14;
/// Corners of a drawn ellipse.
const ELLIPSE_CORNERS: usize = 48;
const POINT_COLOR: Rgb888 = Rgb888::new(64, 224, 255);

/// What is drawn.
#[derive(Clone, Debug)]
pub struct Picture<'a> {
    /// Above the axes.
    pub title: String,
    /// Where the pixels are.
    pub grid: Grid,
    /// One value per pixel, row by row: amplitude, drawn as decibels under its maximum.
    pub amplitude: &'a [f32],
    /// Points to mark.
    pub points: &'a [MeasuredPoint],
}

impl<'a> Picture<'a> {
    /// The picture of an imaged sweep.
    #[must_use]
    pub fn of_image(title: String, image: &'a Image, points: &'a [MeasuredPoint]) -> Self {
        Self { title, grid: image.grid, amplitude: &image.amplitude, points }
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_png(&self, output: impl Write) -> Result<(), png::EncodingError> {
        self.canvas().write_png(output)
    }

    /// The picture as pixels.
    #[must_use]
    pub fn canvas(&self) -> Canvas {
        let frame = Frame::of(&self.grid);
        let mut canvas = Canvas::new(
            frame.width + MARGIN_RIGHT + MARGIN_LEFT.unsigned_abs(),
            frame.height + MARGIN_BOTTOM + MARGIN_TOP.unsigned_abs(),
        );
        self.draw_pixels(&mut canvas, &frame);
        draw_axes(&mut canvas, &frame);
        draw_scale(&mut canvas, &frame);
        for point in self.points {
            draw_point(&mut canvas, &frame, point);
        }
        let middle = MARGIN_LEFT + frame.width.cast_signed() / 2;
        canvas.text(&self.title, Pixel::new(middle, 9), Anchor::Middle);
        canvas
    }

    fn draw_pixels(&self, canvas: &mut Canvas, frame: &Frame) {
        let strongest = self.amplitude.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        for y in 0..frame.height {
            for x in 0..frame.width {
                let amplitude = frame.index(x, y).map_or(0.0, |index| self.amplitude[index]);
                let db = 20.0 * f64::from((amplitude / strongest).max(f32::MIN_POSITIVE)).log10();
                let at = Pixel::new(x.cast_signed() + MARGIN_LEFT, y.cast_signed() + MARGIN_TOP);
                canvas.set(at, shade(1.0 - db / FLOOR_DB));
            }
        }
    }
}

/// How metres become pixels: the plot area, with `y` upwards.
struct Frame {
    grid: Grid,
    width: u32,
    height: u32,
    pixels_per_m: f64,
}

impl Frame {
    fn of(grid: &Grid) -> Self {
        let extent_m = |count: usize| grid.pixel_m * count as f64;
        let (width_m, height_m) = (extent_m(grid.column_count), extent_m(grid.row_count));
        let pixels_per_m = f64::from(PLOT_PIXELS) / width_m.max(height_m);
        let pixels = |metres: f64| to_u32((metres * pixels_per_m).round()).clamp(1, PLOT_PIXELS);
        Self { grid: *grid, width: pixels(width_m), height: pixels(height_m), pixels_per_m }
    }

    fn left_m(&self) -> f64 {
        self.grid.x_min_m - 0.5 * self.grid.pixel_m
    }

    fn bottom_m(&self) -> f64 {
        self.grid.y_min_m - 0.5 * self.grid.pixel_m
    }

    /// The image's pixel under a pixel of the plot.
    fn index(&self, x: u32, y: u32) -> Option<usize> {
        let from_left_m = (f64::from(x) + 0.5) / self.pixels_per_m;
        let from_bottom_m = (f64::from(self.height - y) - 0.5) / self.pixels_per_m;
        let column = to_u32((from_left_m / self.grid.pixel_m).floor()) as usize;
        let row = to_u32((from_bottom_m / self.grid.pixel_m).floor()) as usize;
        let inside = column < self.grid.column_count && row < self.grid.row_count;
        inside.then_some(row * self.grid.column_count + column)
    }

    fn place(&self, x_m: f64, y_m: f64) -> Pixel {
        let x = (x_m - self.left_m()) * self.pixels_per_m;
        let y = f64::from(self.height) - (y_m - self.bottom_m()) * self.pixels_per_m;
        Pixel::new(to_i32(x) + MARGIN_LEFT, to_i32(y) + MARGIN_TOP)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before")]
fn to_u32(value: f64) -> u32 {
    value.clamp(0.0, 1e9) as u32
}

#[expect(clippy::cast_possible_truncation, reason = "clamped before")]
fn to_i32(value: f64) -> i32 {
    value.round().clamp(-1e6, 1e6) as i32
}

/// The colour of a share of the scale, 0 the weakest and 1 the strongest.
fn shade(share: f64) -> Rgb888 {
    let color = colorous::INFERNO.eval_continuous(share.clamp(0.0, 1.0));
    Rgb888::new(color.r, color.g, color.b)
}

fn draw_axes(canvas: &mut Canvas, frame: &Frame) {
    let bottom = MARGIN_TOP + frame.height.cast_signed();
    let step_m = if 12.0 < f64::from(PLOT_PIXELS) / frame.pixels_per_m { 5.0 } else { 1.0 };
    let ticks = |from_m: f64, length: u32| {
        let to_m = from_m + f64::from(length) / frame.pixels_per_m;
        let first = to_i32((from_m / step_m).ceil());
        (first..=to_i32((to_m / step_m).floor())).map(move |tick| f64::from(tick) * step_m)
    };
    for x_m in ticks(frame.left_m(), frame.width) {
        let x = frame.place(x_m, 0.0).x;
        canvas.line(Pixel::new(x, bottom), Pixel::new(x, bottom + 4), Rgb888::WHITE);
        canvas.text(&format!("{x_m}"), Pixel::new(x, bottom + 12), Anchor::Middle);
    }
    for y_m in ticks(frame.bottom_m(), frame.height) {
        let y = frame.place(0.0, y_m).y;
        canvas.line(Pixel::new(MARGIN_LEFT - 5, y), Pixel::new(MARGIN_LEFT - 1, y), Rgb888::WHITE);
        canvas.text(&format!("{y_m}"), Pixel::new(MARGIN_LEFT - 8, y), Anchor::Right);
    }
    let middle = MARGIN_LEFT + frame.width.cast_signed() / 2;
    canvas.text("x in m, to the right", Pixel::new(middle, bottom + 30), Anchor::Middle);
    canvas.text("y in m", Pixel::new(4, MARGIN_TOP - 10), Anchor::Left);
}

fn draw_scale(canvas: &mut Canvas, frame: &Frame) {
    let left = MARGIN_LEFT + frame.width.cast_signed() + 16;
    for y in 0..frame.height {
        let share = 1.0 - f64::from(y) / f64::from(frame.height);
        for x in 0..BAR_WIDTH {
            canvas.set(
                Pixel::new(left + x.cast_signed(), MARGIN_TOP + y.cast_signed()),
                shade(share),
            );
        }
    }
    let right = left + BAR_WIDTH.cast_signed() + 6;
    for tick in 0..=3 {
        let db = -(FLOOR_DB.abs() * f64::from(tick) / 3.0).round();
        let db = if tick == 0 { 0.0 } else { db };
        let y = MARGIN_TOP + to_i32(f64::from(frame.height) * f64::from(tick) / 3.0);
        canvas.text(&format!("{db:.0} dB"), Pixel::new(right, y), Anchor::Left);
    }
}

fn draw_point(canvas: &mut Canvas, frame: &Frame, point: &MeasuredPoint) {
    let position = point.position();
    draw_ellipse(canvas, frame, &Ellipse { position, color: POINT_COLOR, is_dashed: false });
    let at = frame.place(point.x_m, point.y_m);
    canvas.line(at - Pixel::new(4, 0), at + Pixel::new(4, 0), POINT_COLOR);
    canvas.line(at - Pixel::new(0, 4), at + Pixel::new(0, 4), POINT_COLOR);
}

/// An ellipse at two standard deviations of `position`.
struct Ellipse {
    position: Gaussian<Node>,
    color: Rgb888,
    is_dashed: bool,
}

fn draw_ellipse(canvas: &mut Canvas, frame: &Frame, ellipse: &Ellipse) {
    let Ellipse { position, color, is_dashed } = ellipse;
    let (major_m, minor_m, angle_rad) = principal_axes(&position.cov_m2);
    let (sin, cos) = angle_rad.sin_cos();
    let corner = |index: usize| {
        let turn = std::f64::consts::TAU * index as f64 / ELLIPSE_CORNERS as f64;
        let (along_m, across_m) = (2.0 * major_m * turn.cos(), 2.0 * minor_m * turn.sin());
        frame.place(
            position.mean.x_m() + cos * along_m - sin * across_m,
            position.mean.y_m() + sin * along_m + cos * across_m,
        )
    };
    for index in (0..ELLIPSE_CORNERS).step_by(if *is_dashed { 2 } else { 1 }) {
        canvas.line(corner(index), corner(index + 1), *color);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bright_pixel_shows_where_it_is() {
        let grid =
            Grid { x_min_m: -2.0, y_min_m: 0.0, pixel_m: 1.0, column_count: 5, row_count: 5 };
        let mut amplitude = vec![0.0; 25];
        amplitude[3 * 5 + 1] = 2.0; // x = -1 m, y = 3 m
        let picture = Picture { title: "t".to_owned(), grid, amplitude: &amplitude, points: &[] };
        let mut file = Vec::new();
        picture.write_png(&mut file).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let frame = Frame::of(&grid);
        let color = |x_m: f64, y_m: f64| {
            let at = frame.place(x_m, y_m);
            let index = usize::try_from(at.y).unwrap() * info.width as usize
                + usize::try_from(at.x).unwrap();
            [pixels[3 * index], pixels[3 * index + 1], pixels[3 * index + 2]]
        };
        let rgb = |c: Rgb888| [c.r(), c.g(), c.b()];
        assert_eq!(color(-1.0, 3.0), rgb(shade(1.0)));
        for (x_m, y_m) in [(1.0, 3.0), (-1.0, 1.0), (-1.0, 4.0), (0.0, 3.0)] {
            assert_eq!(color(x_m, y_m), rgb(shade(0.0)), "{x_m} {y_m}");
        }
    }
}
