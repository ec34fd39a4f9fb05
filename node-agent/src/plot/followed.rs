//! People who are followed, drawn over a picture: their templates as ellipses, with their ids.

use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::Point as Pixel;
use proto::geom::{Gaussian, Point};
use proto::measured::symmetric;
use proto::radar::Grid;
use proto::wire::{TrackRecord, TrackStatus};

use super::{Ellipse, Frame, draw_ellipse};
use chart::canvas::{Anchor, Canvas};

/// Told apart by most eyes on dark ground; the same person has the same colour in every frame.
pub(super) const COLORS: [Rgb888; 7] = [
    Rgb888::new(86, 180, 233),
    Rgb888::new(0, 200, 140),
    Rgb888::new(204, 121, 167),
    Rgb888::new(0, 130, 220),
    Rgb888::new(120, 220, 60),
    Rgb888::new(170, 140, 255),
    Rgb888::new(60, 220, 220),
];
/// Of whom it is not known yet whether they are somebody.
pub(super) const TENTATIVE_COLOR: Rgb888 = Rgb888::new(150, 150, 150);

/// The colour of a person.
fn color(track: &TrackRecord) -> Rgb888 {
    let count = COLORS.len() as u64;
    let index = usize::try_from(track.id % count).unwrap_or(0);
    if track.status == TrackStatus::Tentative { TENTATIVE_COLOR } else { COLORS[index] }
}

/// Draws `tracks` over the picture of an image on `grid`: an ellipse as large as what is seen of the
/// person (two standard deviations, the rim of an evenly filled ellipse), dashed while the person is
/// not seen, and the id beside it.
pub fn draw_tracks(canvas: &mut Canvas, grid: &Grid, tracks: &[TrackRecord]) {
    let frame = Frame::of(grid);
    for track in tracks {
        let [x_m, y_m, ..] = track.state;
        let position = Gaussian { mean: Point::new(x_m, y_m), cov_m2: symmetric(track.extent_m2) };
        let is_dashed = track.status == TrackStatus::Coasting;
        let color = color(track);
        draw_ellipse(canvas, &frame, &Ellipse { position, color, is_dashed });
        let at = frame.place(x_m, y_m);
        canvas.line(at - Pixel::new(2, 0), at + Pixel::new(2, 0), color);
        canvas.line(at - Pixel::new(0, 2), at + Pixel::new(0, 2), color);
        let beside = frame.place(x_m + 2.0 * track.extent_m2[0].max(0.0).sqrt(), y_m);
        canvas.text(&track.id.to_string(), beside + Pixel::new(5, 0), Anchor::Left);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_is_drawn_around_its_place_in_the_persons_colour() {
        let grid =
            Grid { x_min_m: -2.0, y_min_m: 0.0, pixel_m: 0.05, column_count: 81, row_count: 81 };
        let track = |id, status| TrackRecord {
            id,
            status,
            state: [0.0, 2.0, 0.0, 0.0],
            covariance: [0.0; 10],
            extent_m2: [0.25, 0.0, 0.0625],
            appearance: 1.0,
            unseen_s: 0.0,
        };
        let drawn = |one: TrackRecord| {
            let frame = Frame::of(&grid);
            let mut canvas = Canvas::new(frame.width + 200, frame.height + 200);
            draw_tracks(&mut canvas, &grid, std::slice::from_ref(&one));
            // The rim of the ellipse: 1 m to the left and 0.5 m above the middle.
            [frame.place(-1.0, 2.0), frame.place(0.0, 2.5), frame.place(-0.5, 2.0)]
                .map(|at| canvas.get(at).unwrap())
        };
        let black = Rgb888::new(0, 0, 0);
        assert_eq!(drawn(track(8, TrackStatus::Confirmed)), [COLORS[1], COLORS[1], black]);
        let grey = TENTATIVE_COLOR;
        assert_eq!(drawn(track(8, TrackStatus::Tentative)), [grey, grey, black]);
    }
}
