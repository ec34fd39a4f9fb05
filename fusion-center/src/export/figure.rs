//! Tracks on a map as a picture: ways, status, ellipses and plots, in kilometres east and north.

use std::ops::Range;

use plotters::chart::{ChartBuilder, ChartContext, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{
    Circle, Cross, DynElement, EmptyElement, IntoDynElement, PathElement, Rectangle, Text,
};
use plotters::prelude::{
    BLACK, Cartesian2d, Color, DrawingBackend, IntoDrawingArea, IntoFont, RGBColor, SVGBackend,
    ShapeStyle, WHITE,
};
use proto::geodesy::{EnuFrame, GeoPosition};

use super::{ELLIPSE_SHARE, ExportError, GeoTrack, TrackStatus, ellipse};

/// Of the picture, pixels; what title and axes leave is a square.
pub const SIZE: (u32, u32) = (789, 800);
/// Told apart by most eyes, in print too (Okabe and Ito).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 94, 240),
];
const PLOT_COLOR: RGBColor = RGBColor(150, 150, 150);
/// Half the size of a mark, pixels.
const MARK: i32 = 5;
/// Space around what is shown, as a share of its size.
const MARGIN: f64 = 0.08;

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type PlaceKm = (f64, f64);

/// What is on the map.
#[derive(Clone, Copy, Debug)]
pub struct Map<'a> {
    /// Above it.
    pub title: &'a str,
    /// Whose origin is the map's; positions are shown east and north of it in its plane.
    pub frame: &'a EnuFrame,
    /// A colour for each, a mark for its status at its last place.
    pub tracks: &'a [GeoTrack],
    /// What the sensors reported, right or wrong.
    pub plots: &'a [GeoPosition],
}

impl Map<'_> {
    /// The picture as SVG; the same map gives the same text.
    ///
    /// # Errors
    /// If a track says something that is not possible, or the library refuses.
    pub fn svg(&self) -> Result<String, ExportError> {
        self.tracks.iter().try_for_each(GeoTrack::check)?;
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        self.draw(&area).map_err(|error| ExportError::Drawing(error.to_string()))?;
        drop(area);
        Ok(svg)
    }

    /// Draws the map with any backend of the library. The tracks have been checked.
    ///
    /// # Errors
    /// If the backend fails.
    pub fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let [east, north] = self.ranges_km();
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, ("sans-serif", 18).into_font())
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(56)
            .build_cartesian_2d(east, north)?;
        let (east_title, north_title) = self.axis_titles();
        chart
            .configure_mesh()
            .x_desc(east_title)
            .y_desc(north_title)
            .light_line_style(WHITE)
            .bold_line_style(BLACK.mix(0.08))
            .draw()?;
        self.draw_plots(&mut chart)?;
        for (index, track) in self.tracks.iter().enumerate() {
            self.draw_track(&mut chart, track, COLORS[index % COLORS.len()])?;
        }
        self.draw_legend(&mut chart)?;
        area.present()
    }

    fn axis_titles(&self) -> (String, String) {
        let origin = self.frame.origin();
        let (lat_deg, lon_deg) = (origin.lat_deg(), origin.lon_deg());
        (
            format!("km east of longitude {lon_deg:.5} deg"),
            format!("km north of latitude {lat_deg:.5} deg"),
        )
    }

    fn place_km(&self, place: &GeoPosition) -> PlaceKm {
        let point = self.frame.to_enu(place);
        (point.east_m / 1e3, point.north_m / 1e3)
    }

    fn way_km(&self, track: &GeoTrack) -> Vec<PlaceKm> {
        track.fixes().map(|fix| self.place_km(&fix.position)).collect()
    }

    fn draw_plots<B: DrawingBackend>(&self, chart: &mut Chart<'_, B>) -> Drawn<B> {
        let dots =
            self.plots.iter().map(|plot| Circle::new(self.place_km(plot), 2, PLOT_COLOR.filled()));
        chart.draw_series(dots)?;
        Ok(())
    }

    fn draw_track<B: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, B>,
        track: &GeoTrack,
        color: RGBColor,
    ) -> Drawn<B> {
        let width = if track.status == TrackStatus::Tentative { 1 } else { 2 };
        chart.draw_series([PathElement::new(self.way_km(track), color.stroke_width(width))])?;
        chart.draw_series([PathElement::new(
            self.outline_km(track),
            color.mix(0.7).stroke_width(1),
        )])?;
        let at = self.place_km(&track.position);
        chart.draw_series([EmptyElement::at(at) + mark((0, 0), track.status, color)])?;
        let font = ("sans-serif", 12).into_font().color(&color);
        let label = Text::new(track.id.to_string(), (MARK + 4, -MARK - 8), font);
        chart.draw_series([EmptyElement::at(at) + label])?;
        Ok(())
    }

    /// The ellipse around the last place, closed. The covariance is of the axes at the target; on a
    /// map of some ten kilometres they are those of the map to a fraction of a degree.
    fn outline_km(&self, track: &GeoTrack) -> Vec<PlaceKm> {
        let (east_km, north_km) = self.place_km(&track.position);
        let outline = ellipse::outline_m(track, ELLIPSE_SHARE);
        let corners = outline.iter().map(|at| (east_km + at.x / 1e3, north_km + at.y / 1e3));
        corners.clone().chain(corners.take(1)).collect()
    }

    fn draw_legend<'a, B: DrawingBackend + 'a>(&self, chart: &mut Chart<'a, B>) -> Drawn<B> {
        for status in TrackStatus::ALL {
            chart
                .draw_series(nothing())?
                .label(status.word())
                .legend(move |(x, y)| mark((x + 10, y), status, BLACK));
        }
        let ellipse = BLACK.mix(0.7).stroke_width(1);
        chart
            .draw_series(nothing())?
            .label("95 % of its place")
            .legend(move |(x, y)| PathElement::new(vec![(x + 2, y), (x + 18, y)], ellipse));
        if !self.plots.is_empty() {
            chart
                .draw_series(nothing())?
                .label("plot")
                .legend(|(x, y)| Circle::new((x + 10, y), 2, PLOT_COLOR.filled()));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .draw()
    }

    /// Equal scales on both axes, everything inside.
    fn ranges_km(&self) -> [Range<f64>; 2] {
        let ways = self.tracks.iter().flat_map(|track| self.way_km(track));
        let outlines = self.tracks.iter().flat_map(|track| self.outline_km(track));
        let plots = self.plots.iter().map(|plot| self.place_km(plot));
        let mut limits = [(f64::MAX, f64::MIN); 2];
        for (east_km, north_km) in ways.chain(outlines).chain(plots) {
            for (limit, value) in limits.iter_mut().zip([east_km, north_km]) {
                *limit = (limit.0.min(value), limit.1.max(value));
            }
        }
        let known =
            limits.map(|(least, most)| if least <= most { (least, most) } else { (0.0, 1.0) });
        let half = known.iter().map(|(least, most)| 0.5 * (most - least)).fold(0.05, f64::max);
        known.map(|(least, most)| {
            let (middle, reach) = (0.5 * (least + most), half * (1.0 + 2.0 * MARGIN));
            middle - reach..middle + reach
        })
    }
}

/// A series of nothing, for an entry in the legend.
fn nothing() -> [Circle<PlaceKm, i32>; 0] {
    []
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
        Map { title: "Tracks near Hohhot", frame: &sample::frame(), tracks, plots }.svg().unwrap()
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
        let map = Map { title: "", frame: &sample::frame(), tracks: &local(), plots: &[] };
        let (east_km, north_km) = map.place_km(&sample::confirmed().position);
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
        let map = Map { title: "", frame: &sample::frame(), tracks: &tracks, plots: &[] };
        assert!(matches!(map.svg(), Err(ExportError::Time { .. })));
    }
}
