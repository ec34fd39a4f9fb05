//! Lines and outlines cut where they cross the antimeridian, as RFC 7946 section 3.1.9 asks.

use proto::geodesy::{GeoPosition, wrap_lon_deg};

/// Longitude and latitude, degrees; 180 on the western side of the antimeridian, −180 on the
/// eastern.
pub(super) type LonLat = [f64; 2];

/// A line in as many pieces as it has sides; each but the last ends on the antimeridian.
pub(super) fn cut_line(places: &[GeoPosition]) -> Vec<Vec<LonLat>> {
    let mut pieces: Vec<Vec<LonLat>> = Vec::new();
    let mut before: Option<LonLat> = None;
    for [lon_deg, lat_deg] in unwrapped(places) {
        let side = side_of(lon_deg);
        if let Some(last) = before.filter(|last| (side_of(last[0]) - side).abs() > 0.5) {
            let border_deg = 360.0 * side_of(last[0]).max(side) - 180.0;
            let share = (border_deg - last[0]) / (lon_deg - last[0]);
            let crossing_deg = last[1] + share * (lat_deg - last[1]);
            let (end_deg, start_deg) =
                if side > side_of(last[0]) { (180.0, -180.0) } else { (-180.0, 180.0) };
            pieces.last_mut().into_iter().for_each(|piece| piece.push([end_deg, crossing_deg]));
            pieces.push(vec![[start_deg, crossing_deg]]);
        }
        if pieces.is_empty() {
            pieces.push(Vec::new());
        }
        let corner = [lon_deg - 360.0 * side, lat_deg];
        pieces.last_mut().into_iter().for_each(|piece| piece.push(corner));
        before = Some([lon_deg, lat_deg]);
    }
    pieces
}

/// A convex outline as closed rings, one for each side of the antimeridian that it touches.
/// Meant for outlines that are small beside the earth and hold no pole.
pub(super) fn cut_ring(places: &[GeoPosition]) -> Vec<Vec<LonLat>> {
    let ring = unwrapped(places);
    let sides = || ring.iter().map(|corner| side_of(corner[0]));
    let (least, most) = (sides().fold(f64::MAX, f64::min), sides().fold(f64::MIN, f64::max));
    if most - least < 0.5 {
        return vec![closed(
            ring.iter().map(|corner| [corner[0] - 360.0 * most, corner[1]]).collect(),
        )];
    }
    let border_deg = 360.0 * most - 180.0;
    let west = clipped(&ring, border_deg, -1.0);
    let east = clipped(&ring, border_deg, 1.0);
    let moved = |corners: Vec<LonLat>, side: f64| {
        closed(corners.into_iter().map(|corner| [corner[0] - 360.0 * side, corner[1]]).collect())
    };
    vec![moved(west, least), moved(east, most)]
}

/// Longitudes that go on without jumps, whole turns beyond ±180 where need be.
fn unwrapped(places: &[GeoPosition]) -> Vec<LonLat> {
    let mut lon_deg = places.first().map_or(0.0, GeoPosition::lon_deg);
    let step = |place: &GeoPosition| {
        lon_deg += wrap_lon_deg(place.lon_deg() - lon_deg);
        [lon_deg, place.lat_deg()]
    };
    places.iter().map(step).collect()
}

/// How many turns a longitude without jumps is off [−180, 180).
fn side_of(lon_deg: f64) -> f64 {
    ((lon_deg + 180.0) / 360.0).floor()
}

/// What of a convex outline lies on one side of a meridian (Sutherland and Hodgman, one edge).
fn clipped(ring: &[LonLat], border_deg: f64, sign: f64) -> Vec<LonLat> {
    let inside = |corner: &LonLat| sign * (corner[0] - border_deg) >= 0.0;
    let next = ring.iter().cycle().skip(1);
    let edges = ring.iter().zip(next).flat_map(|(from, to)| {
        let share = (border_deg - from[0]) / (to[0] - from[0]);
        let crossing = [border_deg, from[1] + share * (to[1] - from[1])];
        let crosses = inside(from) != inside(to);
        [inside(from).then_some(*from), crosses.then_some(crossing)]
    });
    edges.flatten().collect()
}

fn closed(mut corners: Vec<LonLat>) -> Vec<LonLat> {
    let first = corners.first().copied();
    corners.extend(first);
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::sample::position;

    fn line(lons_deg: &[f64]) -> Vec<GeoPosition> {
        let place = |(index, lon_deg): (u32, &f64)| position(f64::from(index), *lon_deg, 0.0);
        (0..).zip(lons_deg).map(place).collect()
    }

    #[test]
    fn a_line_that_crosses_nothing_stays_whole() {
        assert_eq!(cut_line(&line(&[10.0, 11.0, -5.0])), [[[10.0, 0.0], [11.0, 1.0], [-5.0, 2.0]]]);
        assert!(cut_line(&[]).is_empty());
    }

    #[test]
    fn a_line_is_cut_on_the_antimeridian_both_ways() {
        let there = cut_line(&line(&[179.0, -179.0, -178.0]));
        let expected =
            [vec![[179.0, 0.0], [180.0, 0.5]], vec![[-180.0, 0.5], [-179.0, 1.0], [-178.0, 2.0]]];
        assert_eq!(there, expected);
        let back = cut_line(&line(&[-179.0, 179.0]));
        assert_eq!(back, [[[-179.0, 0.0], [-180.0, 0.5]], [[180.0, 0.5], [179.0, 1.0]]]);
        // There and back again, and all the way round.
        assert_eq!(cut_line(&line(&[179.0, -179.0, 179.0])).len(), 3);
        let round = cut_line(&line(&[0.0, 120.0, -120.0, 0.0, 120.0, -120.0]));
        assert_eq!(round.len(), 3);
        assert!(round.iter().flatten().all(|corner| corner[0].abs() <= 180.0));
    }

    /// Twice the signed area, degrees².
    fn area(ring: &[LonLat]) -> f64 {
        ring.windows(2).map(|edge| edge[0][0] * edge[1][1] - edge[0][1] * edge[1][0]).sum()
    }

    #[test]
    fn an_outline_is_cut_into_closed_rings_of_the_same_area_and_turn() {
        for middle_deg in [50.0, 179.2, -179.6, -180.0] {
            let corner = |index: u32| {
                let turn = f64::from(index) * std::f64::consts::TAU / 32.0;
                position(10.0 + turn.sin(), (middle_deg + turn.cos()) % 360.0, 0.0)
            };
            let rings = cut_ring(&(0..32).map(corner).collect::<Vec<_>>());
            assert_eq!(rings.len(), if middle_deg > 0.0 && middle_deg < 60.0 { 1 } else { 2 });
            let whole = 32.0 * (std::f64::consts::TAU / 32.0).sin();
            let sum: f64 = rings.iter().map(|ring| area(ring)).sum();
            assert!((sum - whole).abs() < 1e-9, "{middle_deg}: {sum} {whole}");
            for ring in &rings {
                assert_eq!(ring.first(), ring.last());
                assert!(area(ring) > 0.0);
                assert!(ring.iter().all(|at| (-180.0..=180.0).contains(&at[0])), "{ring:?}");
            }
        }
    }
}
