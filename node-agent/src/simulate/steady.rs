//! Echoes of what stands, worked out once: clutter, mirrors, the wall's faces, the coupling.
//!
//! What people shade is kept apart: in each sweep every channel of such an echo is weighted by what
//! people leave of the two straight rays from its antennas to its place of reflection.

use crate::imaging::from_db;
use nalgebra::Vector2;
use rustfft::num_complex::Complex;

use proto::geom::Point;

use super::echoes::EchoSimulator;
use super::mirrors::Mirror;
use super::scene::{Clutter, TargetKind};
use super::spectra::Spectra;
use super::streams::Moment;

/// Echoes of what stands.
#[derive(Clone, Debug)]
pub(super) struct Steady {
    /// The sum of all that nobody shades.
    sum: Spectra,
    /// Echoes that people shade, each with the place of reflection of every channel.
    shaded: Vec<Placed>,
}

impl Steady {
    /// Nothing; `zeros` has a row for every channel.
    pub(super) fn none(zeros: Spectra) -> Self {
        Self { sum: zeros, shaded: Vec::new() }
    }
}

/// A static echo with the place where each channel's is reflected.
type Placed = (Spectra, Vec<Vector2<f64>>);

impl EchoSimulator {
    /// Works out the echoes of what stands.
    pub(super) fn steady_echoes(&self) -> Steady {
        let band = &self.radar.band;
        let zeros = Spectra::zeros(self.radar.array.channel_count(), band);
        let mut sum = zeros.clone();
        for (channel, (tx_m, rx_m)) in self.pairs().enumerate() {
            for echo in self.slab.face_echoes(&tx_m, &rx_m) {
                let gain = self.specular(echo.path_m) * echo.amplitude;
                sum.add_wave(channel, band, echo.path_m, gain);
            }
            self.add_coupling(&mut sum, channel, (tx_m - rx_m).norm());
        }
        let clutter = self.scene.clutter.iter().map(|thing| self.clutter_echo(thing, &zeros));
        let mirrors = self.mirrors.iter().map(|mirror| self.mirror_echo(mirror, &zeros));
        let mut shaded: Vec<Placed> = clutter.chain(mirrors).collect();
        if self.scene.shadow.is_none() {
            for (echo, places) in shaded.drain(..) {
                (0..places.len()).for_each(|channel| sum.add_row(channel, &echo, 1.0));
            }
        }
        Steady { sum, shaded }
    }

    /// The amplitude of a perfect mirror whose echo comes `path_m`.
    fn specular(&self, path_m: f64) -> Complex<f64> {
        let law = self.scene.amplitude_law.specular_amplitude(path_m);
        Complex::from(from_db(self.scene.specular_db).sqrt() * law)
    }

    fn clutter_echo(&self, thing: &Clutter, zeros: &Spectra) -> Placed {
        let place = self.node_from_world * Point::new(thing.x_m, thing.y_m);
        let scatterer = self.scatterer(place, thing.amplitude_db);
        let mut echo = zeros.clone();
        if self.slab.is_open(&place.coords_m) {
            self.add_scatterer(&mut echo, &mut self.no_ways(), &scatterer, &[]);
        }
        (echo, self.pairs().map(|_| place.coords_m).collect())
    }

    fn mirror_echo(&self, mirror: &Mirror, zeros: &Spectra) -> Placed {
        let mut echo = zeros.clone();
        let mut places = Vec::new();
        for (channel, (tx_m, rx_m)) in self.pairs().enumerate() {
            let glares = mirror.glares(&self.slab, &tx_m, &rx_m);
            for glare in &glares {
                let gain = self.specular(glare.path_m) * (mirror.coefficient * glare.amplitude);
                echo.add_wave(channel, &self.radar.band, glare.path_m, gain);
            }
            // Without an echo it does not matter where it is shaded.
            places.push(glares.first().map_or(tx_m, |glare| glare.place_m));
        }
        (echo, places)
    }

    fn add_coupling(&self, sum: &mut Spectra, channel: usize, distance_m: f64) {
        let Some(coupling) = &self.disturbance.coupling else { return };
        let reference = self.reference_amplitude();
        for wave in coupling.waves(channel, distance_m, reference, &self.streams) {
            sum.add_wave(channel, &self.radar.band, wave.path_m, wave.gain);
        }
    }

    /// The echoes of what stands at `moment`, shaded by who is in the way then.
    pub(super) fn steady_at(&self, moment: Moment) -> Spectra {
        let mut sums = self.steady.sum.clone();
        let Some(shadow) = &self.scene.shadow else { return sums };
        let people_m = self.people_m(moment);
        for (echo, places) in &self.steady.shaded {
            for (channel, ((tx_m, rx_m), place_m)) in self.pairs().zip(places).enumerate() {
                let left = shadow.left_of(&tx_m, place_m, &people_m)
                    * shadow.left_of(&rx_m, place_m, &people_m);
                sums.add_row(channel, echo, left);
            }
        }
        sums
    }

    /// Where the people are who are seen.
    fn people_m(&self, moment: Moment) -> Vec<Vector2<f64>> {
        let places = self.targets_in_node(moment.time_s);
        let is_person = |index: &usize| {
            self.scene.targets[*index].kind != TargetKind::Point
                && self.is_visible(*index, moment.period_index)
        };
        (0..places.len()).filter(is_person).map(|index| places[index].coords_m).collect()
    }
}
