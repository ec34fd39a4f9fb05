//! What is truly in a sweep: targets, what hides them, and the ghosts they cast.

use crate::imaging::from_db;
use nalgebra::Vector2;

use proto::geom::{Node, Point};

use super::echoes::EchoSimulator;
use super::scene::TargetKind;

/// Shadows that take less than this of an amplitude cast no ghost worth naming.
const MIN_SHADE: f64 = 0.01;

/// The truth about one sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Where the middles of all targets are, in the order of the scene.
    pub targets_in_node: Vec<Point<Node>>,
    /// Whether each of them shows: it is not missed, and stands before the array outside the wall.
    pub visible: Vec<bool>,
    /// Where there is a false target, if there is one.
    pub false_target: Option<Point<Node>>,
    /// What appears where nothing is, of the targets that show.
    pub ghosts: Vec<Ghost>,
}

/// Why something appears where nothing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// One leg goes over the mirror, the other is straight. Its range is sharp, the mean of both
    /// legs; in direction it spreads, as no single place explains all channels, and is given at
    /// the mean sine of the legs.
    OneBounce,
    /// Both legs go over the mirror: the target's image.
    TwoBounces,
    /// The target shades the mirror's own echo, which moves therefore.
    ShadedMirror,
    /// The target shades clutter, which moves therefore.
    ShadedClutter,
}

/// Something that appears where nothing is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ghost {
    /// Why.
    pub cause: Cause,
    /// Which target.
    pub target_index: usize,
    /// Which reflector or clutter of the scene.
    pub source_index: usize,
    /// Where, after the wall's delay is taken out.
    pub place: Point<Node>,
    /// Power over that of the target's own echo, decibels; of shaded things that of the change.
    pub over_target_db: f64,
}

impl EchoSimulator {
    /// What is truly in the sweep of period `period_index` at `time_s`.
    #[must_use]
    pub fn truth(&self, period_index: u64, time_s: f64) -> Truth {
        let targets_in_node = self.targets_in_node(time_s);
        let shows = |(index, place): (usize, &Point<Node>)| {
            self.is_visible(index, period_index) && self.slab.is_open(&place.coords_m)
        };
        let visible: Vec<bool> = targets_in_node.iter().enumerate().map(shows).collect();
        let mut ghosts = Vec::new();
        for (index, place) in targets_in_node.iter().enumerate().filter(|(i, _)| visible[*i]) {
            ghosts.extend(self.bounces(index, &place.coords_m));
            ghosts.extend(self.shades(index, &place.coords_m));
        }
        Truth { targets_in_node, visible, false_target: self.false_target(period_index), ghosts }
    }

    fn bounces(&self, target_index: usize, place_m: &Vector2<f64>) -> Vec<Ghost> {
        let mut ghosts = Vec::new();
        let mirrors = self.mirrors.iter().enumerate();
        for (source_index, (image_m, amplitude)) in mirrors.flat_map(|(index, mirror)| {
            let images = self.images(place_m, std::slice::from_ref(mirror));
            images.into_iter().map(move |image| (index, image))
        }) {
            let range_m = 0.5 * (place_m.norm() + image_m.norm());
            let sine = 0.5 * (place_m.x / place_m.norm() + image_m.x / image_m.norm());
            let between_m = Vector2::new(sine, (1.0 - sine * sine).sqrt()) * range_m;
            let bounce_db = 20.0 * amplitude.abs().log10();
            let ghost = |cause, at_m, over_target_db| {
                let place = Point::from_coords(at_m);
                Ghost { cause, target_index, source_index, place, over_target_db }
            };
            ghosts.push(ghost(Cause::OneBounce, between_m, bounce_db));
            ghosts.push(ghost(Cause::TwoBounces, image_m, 2.0 * bounce_db));
        }
        ghosts
    }

    /// The things behind a person that lose more than [`MIN_SHADE`] seen from the array's centre.
    fn shades(&self, target_index: usize, place_m: &Vector2<f64>) -> Vec<Ghost> {
        let (scene, centre_m) = (&self.scene, Vector2::zeros());
        let target = &scene.targets[target_index];
        let Some(shadow) = scene.shadow.filter(|_| target.kind != TargetKind::Point) else {
            return Vec::new();
        };
        let law = |m: &Vector2<f64>| scene.amplitude_law.amplitude(m.norm());
        let own = law(place_m) * from_db(target.amplitude_db).sqrt();
        let clutter = scene.clutter.iter().enumerate().filter_map(|(index, thing)| {
            let at_m = (self.node_from_world * Point::new(thing.x_m, thing.y_m)).coords_m;
            let amplitude = law(&at_m) * from_db(thing.amplitude_db).sqrt();
            self.slab.is_open(&at_m).then_some((Cause::ShadedClutter, index, at_m, amplitude))
        });
        let mirrors = self.mirrors.iter().enumerate().filter_map(|(index, mirror)| {
            let glare = *mirror.glares(&self.slab, &centre_m, &centre_m).first()?;
            let specular = from_db(scene.specular_db).sqrt() * mirror.coefficient.abs();
            let amplitude = specular * scene.amplitude_law.specular_amplitude(glare.path_m);
            Some((Cause::ShadedMirror, index, glare.place_m, amplitude))
        });
        let ghost = |(cause, source_index, at_m, amplitude): (Cause, usize, Vector2<f64>, f64)| {
            let lost = 1.0 - shadow.left_of(&centre_m, &at_m, &[*place_m]).powi(2);
            let over_target_db = 20.0 * (amplitude * lost / own).log10();
            let place = Point::from_coords(at_m);
            let ghost = Ghost { cause, target_index, source_index, place, over_target_db };
            (MIN_SHADE < lost).then_some(ghost)
        };
        clutter.chain(mirrors).filter_map(ghost).collect()
    }
}
