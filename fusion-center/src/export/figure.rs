//! Tracks on a map as a picture: ways, status, ellipses and plots, in kilometres east and north.

use std::ops::Range;

use chart::{
    Axes, Chart, Drawn, Fallible, Sheet, around, color, legend, nothing, quiet_corner, square_size,
    squared, stroke, way,
};
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, Cross, DynElement, EmptyElement, IntoDynElement, Rectangle, Text};
use plotters::prelude::{BLACK, Color, DrawingBackend, IntoFont, RGBColor, ShapeStyle, WHITE};
use proto::geodesy::{EnuFrame, GeoPosition};

use super::{ELLIPSE_SHARE, ExportError, GeoTrack, TrackStatus, ellipse};

/// What the axes enclose, pixels.
const SIDE: u32 = 720;
const DOT_COLOR: RGBColor = RGBColor(150, 150, 150);
/// Half the size of a mark, pixels.
const MARK: i32 = 5;
/// Space around what is shown, as a share of its size.
const MARGIN: f64 = 0.08;
/// Half of what is shown at least, kilometres.
const LEAST_HALF_KM: f64 = 0.05;

/// What is on the map.
#[derive(Clone, Copy, Debug)]
pub struct Map<'a> {
    /// Above it.
    pub title: &'a str,
    /// Whose origin is the map's; positions are shown east and north of it in its plane.
    pub frame: &'a EnuFrame,
    /// A colour for each, a mark for its status at its last place.
    pub tracks: &'a [GeoTrack],
    /// Grey dots, such as what sensors reported, right or wrong.
    pub dots: &'a [GeoPosition],
    /// What the dots are, in the legend.
    pub dots_are: &'a str,
}

impl Sheet for Map<'_> {
    fn size(&self) -> Fallible<(u32, u32)> {
        Ok(square_size(SIDE))
    }

    /// The tracks have been checked.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let origin = self.frame.origin();
        let axes = Axes {
            title: self.title,
            x_title: &format!("km east of {}", degrees(origin.lon_deg(), ["E", "W"])),
            y_title: &format!("km north of {}", degrees(origin.lat_deg(), ["N", "S"])),
            ranges: self.ranges_km(),
        };
        let mut chart = axes.on(area)?;
        let dots = self.dots.iter().map(|dot| self.place_km(dot).into());
        chart.draw_series(dots.map(|at| Circle::new(at, 2, DOT_COLOR.filled())))?;
        for (index, track) in self.tracks.iter().enumerate() {
            self.draw_track(&mut chart, track, color(index))?;
        }
        self.draw_legend(&mut chart)?;
        area.present()
    }
}

impl Map<'_> {
    /// The picture as SVG; the same map gives the same text.
    ///
    /// # Errors
    /// If a track says something that is not possible, or the library refuses.
    pub fn checked_svg(&self) -> Result<String, ExportError> {
        self.tracks.iter().try_for_each(GeoTrack::check)?;
        self.svg().map_err(|error| ExportError::Drawing(error.to_string()))
    }

    fn place_km(&self, place: &GeoPosition) -> [f64; 2] {
        let point = self.frame.to_enu(place);
        [point.east_m / 1e3, point.north_m / 1e3]
    }

    fn way_km(&self, track: &GeoTrack) -> impl Iterator<Item = [f64; 2]> {
        track.fixes().map(|fix| self.place_km(&fix.position))
    }

    /// Everything that is to be inside.
    fn places_km(&self) -> impl Iterator<Item = [f64; 2]> {
        let tracks = self.tracks.iter();
        let ways = tracks.flat_map(|track| self.way_km(track).chain(self.outline_km(track)));
        ways.chain(self.dots.iter().map(|dot| self.place_km(dot)))
    }

    /// Equal scales on both axes, everything inside.
    fn ranges_km(&self) -> [Range<f64>; 2] {
        squared(around(self.places_km()), LEAST_HALF_KM, MARGIN)
    }

    fn draw_track<B: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, B>,
        track: &GeoTrack,
        color: RGBColor,
    ) -> Drawn<B> {
        let width = if track.status == TrackStatus::Tentative { 1 } else { 2 };
        way(chart, self.way_km(track), color.stroke_width(width))?;
        way(chart, self.outline_km(track), color.mix(0.7).stroke_width(1))?;
        let at: (f64, f64) = self.place_km(&track.position).into();
        chart.draw_series([EmptyElement::at(at) + mark((0, 0), track.status, color)])?;
        let font = ("sans-serif", 14).into_font().color(&color);
        let label = Text::new(track.id.to_string(), (MARK + 4, -MARK - 10), font);
        chart.draw_series([EmptyElement::at(at) + label])?;
        Ok(())
    }

    /// The ellipse around the last place, closed. The covariance is of the axes at the target; on a
    /// map of some ten kilometres they are those of the map to a fraction of a degree.
    fn outline_km(&self, track: &GeoTrack) -> Vec<[f64; 2]> {
        let [east_km, north_km] = self.place_km(&track.position);
        let outline = ellipse::outline_m(track, ELLIPSE_SHARE);
        let corners = outline.iter().map(|at| [east_km + at.x / 1e3, north_km + at.y / 1e3]);
        corners.clone().chain(corners.take(1)).collect()
    }

    /// What is on the map, and nothing else.
    fn draw_legend<'a, B: DrawingBackend + 'a>(&self, chart: &mut Chart<'a, B>) -> Drawn<B> {
        let is_there = |status| self.tracks.iter().any(|track| track.status == status);
        for status in TrackStatus::ALL.into_iter().filter(|status| is_there(*status)) {
            chart
                .draw_series(nothing())?
                .label(format!("{} at the end", status.word()))
                .legend(move |(x, y)| mark((x + 8, y), status, BLACK));
        }
        if !self.tracks.is_empty() {
            let style = BLACK.mix(0.7).stroke_width(1);
            let entry = move |at| stroke(at, style);
            chart.draw_series(nothing())?.label("where it is, to 95 %").legend(entry);
        }
        if !self.dots.is_empty() {
            let entry = |(x, y)| Circle::new((x + 8, y), 2, DOT_COLOR.filled());
            chart.draw_series(nothing())?.label(self.dots_are).legend(entry);
        }
        if self.tracks.is_empty() && self.dots.is_empty() {
            return Ok(());
        }
        legend(chart, quiet_corner(self.places_km(), &self.ranges_km()))
    }
}

/// As maps write it, such as `113.92575 deg W`.
fn degrees(value_deg: f64, [positive, negative]: [&str; 2]) -> String {
    let side = if value_deg < 0.0 { negative } else { positive };
    format!("{:.5} deg {side}", value_deg.abs())
}

/// A disc for confirmed, a ring for tentative, a cross for coasting, a square for stopped.
fn mark<B: DrawingBackend>(
    at: (i32, i32),
    status: TrackStatus,
    color: RGBColor,
) -> DynElement<'static, B, (i32, i32)> {
    let line: ShapeStyle = color.stroke_width(2);
    match status {
        TrackStatus::Tentative => Circle::new(at, MARK, color.stroke_width(1)).into_dyn(),
        TrackStatus::Confirmed => Circle::new(at, MARK, color.filled()).into_dyn(),
        TrackStatus::Coasting => Cross::new(at, MARK, line).into_dyn(),
        TrackStatus::Stopped => {
            let corners = [(at.0 - MARK, at.1 - MARK), (at.0 + MARK, at.1 + MARK)];
            Rectangle::new(corners, color.filled()).into_dyn()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::sample;

    fn picture(tracks: &[GeoTrack], plots: &[GeoPosition]) -> String {
        let frame = sample::frame();
        let title = "Tracks near Hohhot";
        Map { title, frame: &frame, tracks, dots: plots, dots_are: "plot" }.checked_svg().unwrap()
    }

    fn local() -> Vec<GeoTrack> {
        let mut tracks = sample::all();
        tracks.pop();
        tracks.push(GeoTrack {
            status: TrackStatus::Stopped,
            ..sample::straight(12, [1_500.0, 2_000.0], [-3.0, 9.0])
        });
        tracks
    }

    #[test]
    fn the_same_map_gives_the_same_picture_with_all_labels() {
        let tracks = local();
        let plots: Vec<GeoPosition> =
            tracks.iter().flat_map(|track| track.fixes().map(|fix| fix.position)).collect();
        let svg = picture(&tracks, &plots);
        assert_eq!(svg, picture(&tracks, &plots));
        let words = ["Tracks near Hohhot", "tentative", "confirmed", "coasting", "stopped", "plot"];
        for word in words.into_iter().chain(["km east", "\n12\n", "\n7\n", "\n8\n", "\n9\n"]) {
            assert!(svg.contains(word), "{word:?}");
        }
        assert_eq!(svg.matches("fill=\"#969696\"").count(), plots.len() + 1);
    }

    #[test]
    fn a_track_to_the_east_is_drawn_to_the_right_and_one_to_the_north_above() {
        let (frame, tracks) = (sample::frame(), local());
        let map = Map { title: "", frame: &frame, tracks: &tracks, dots: &[], dots_are: "" };
        let [east_km, north_km] = map.place_km(&sample::confirmed().position);
        assert!((east_km - 2.4).abs() < 1e-6 && (north_km + 1.2).abs() < 1e-6);
        let [east, north] = map.ranges_km();
        assert!((east.end - east.start - (north.end - north.start)).abs() < 1e-9);
        assert!(east.contains(&2.4) && north.contains(&-1.2));
    }

    /// Three points of the plane, a kilometre apart to the east and to the north.
    #[test]
    fn a_kilometre_is_as_long_to_the_east_as_to_the_north() {
        let at = |id, east_m, north_m| GeoTrack {
            history: Vec::new(),
            covariance_m2: nalgebra::Matrix2::zeros(),
            ..sample::straight(id, [east_m, north_m], [0.0, 0.0])
        };
        let svg = picture(&[at(1, 0.0, 0.0), at(2, 1e3, 0.0), at(3, 0.0, 1e3)], &[]);
        let value = |line: &str, name: &str| -> i32 {
            let after = line.split(&format!(" {name}=\"")).nth(1).unwrap();
            after.split('"').next().unwrap().parse().unwrap()
        };
        let discs =
            svg.lines().filter(|line| line.starts_with("<circle") && value(line, "r") == MARK);
        let places: Vec<[i32; 2]> =
            discs.map(|line| [value(line, "cx"), value(line, "cy")]).collect();
        let [origin, east, north] = [places[0], places[1], places[2]];
        assert_eq!((east[1], north[0]), (origin[1], origin[0]));
        let (right, up) = (east[0] - origin[0], origin[1] - north[1]);
        assert!(right > 500 && (right - up).abs() <= 2, "{right} {up}");
    }

    #[test]
    #[ignore = "writes a picture to look at into the folder for temporary files"]
    fn study_the_picture() {
        let tracks = local();
        let plots: Vec<GeoPosition> =
            tracks.iter().flat_map(|track| track.fixes().map(|fix| fix.position)).collect();
        let path = std::env::temp_dir().join("tracks.svg");
        std::fs::write(&path, picture(&tracks, &plots)).unwrap();
        println!("{}", path.display());
    }

    #[test]
    fn an_empty_map_is_a_map() {
        assert!(picture(&[], &[]).contains("km north"));
    }

    #[test]
    fn an_impossible_track_is_refused() {
        let tracks = [GeoTrack { time_unix_s: f64::NAN, ..sample::confirmed() }];
        let frame = sample::frame();
        let map = Map { title: "", frame: &frame, tracks: &tracks, dots: &[], dots_are: "" };
        assert!(matches!(map.checked_svg(), Err(ExportError::Time { .. })));
    }
}
