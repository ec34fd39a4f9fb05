//! What the wall before the array does to echoes: paths, losses, inner reverberation, own echoes.
//!
//! For the electric field perpendicular to the plane of incidence (vertical antennas, paths in the
//! horizontal plane), with `p = sin θ` in the air, `q = sqrt(ε − p²)`, loss small against `ε`:
//! reflection of a face `r = (cos θ − q) / (cos θ + q)`; transmission of both faces `1 − r²`;
//! attenuation along the slab `exp(−α d sqrt ε / q)`, `α = σ η0 / (2 sqrt ε)` nepers per metre
//! \[slab-fresnel\]. A wave that runs to and fro in the slab `m` times more crosses a slab of
//! thickness `(2m + 1) d`, exactly, and has the factor `r^(2m)`.
//! The wall's own echo at a receiver is that of mirrored sources: `r` from the front face, and
//! `(1 − r²)(−r)^(2m−1)` over a slab of thickness `2 m d` from the back, `m = 1, 2, ..`.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use proto::radar::Wall;

use crate::imaging::wall::{leg_path_m, refracted_sine};
use crate::imaging::{InvalidSetting, invalid};

/// Wave impedance of vacuum.
const IMPEDANCE_OHM: f64 = 376.730_313_668;
/// A wall whose faces echo is at least this far before the antennas, metres.
const MIN_STAND_OFF_M: f64 = 0.01;

/// What passes through the wall.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Transmission {
    /// Everything: the wall only delays.
    #[default]
    Lossless,
    /// What Fresnel's formulas and the conductivity leave.
    Fresnel,
}

/// What the wall does besides delaying.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WallEffects {
    /// Distance from the array's line to the front face, metres.
    pub stand_off_m: f64,
    /// What passes.
    pub transmission: Transmission,
    /// Conductivity σ, siemens per metre.
    pub conductivity_s_per_m: f64,
    /// How often a target's echo runs to and fro inside on each leg, at most.
    pub inner_pass_count: usize,
    /// Echoes of the wall itself: 1 for the front, 2 for front and back, more with multiples.
    pub face_echo_count: usize,
}

impl WallEffects {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let of = |field: &str| format!("scene.wall_effects.{field}");
        if !(0.0..=10.0).contains(&self.stand_off_m) {
            return Err(invalid(of("stand_off_m"), self.stand_off_m, "use 0 to 10 m"));
        }
        if !(0.0..=10.0).contains(&self.conductivity_s_per_m) {
            let value = self.conductivity_s_per_m;
            return Err(invalid(of("conductivity_s_per_m"), value, "use 0 to 10 S/m"));
        }
        for (field, count) in
            [("inner_pass_count", self.inner_pass_count), ("face_echo_count", self.face_echo_count)]
        {
            if 8 < count {
                return Err(invalid(of(field), count, "use 0 to 8"));
            }
            if 0 < count && self.transmission == Transmission::Lossless {
                return Err(invalid(of(field), count, "also set transmission = \"fresnel\""));
            }
        }
        if 0 < self.face_echo_count && self.stand_off_m < MIN_STAND_OFF_M {
            let remedy = "let a wall that echoes stand off by 0.01 m or more";
            return Err(invalid(of("stand_off_m"), self.stand_off_m, remedy));
        }
        Ok(())
    }
}

/// One way between an antenna and a place, or from antenna to antenna.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leg {
    pub(super) path_m: f64,
    pub(super) amplitude: f64,
}

/// The wall before one node, in the node's frame.
#[derive(Clone, Debug)]
pub(super) struct Slab {
    wall: Option<Wall>,
    effects: WallEffects,
}

impl Slab {
    pub(super) fn new(wall: Option<Wall>, effects: WallEffects) -> Self {
        Self { wall, effects }
    }

    /// Depth of the wall's far face, metres; 0 without a wall.
    pub(super) fn end_m(&self) -> f64 {
        self.wall.map_or(0.0, |wall| self.effects.stand_off_m + wall.thickness_m)
    }

    /// Whether waves come to `place_m`: before the array, and not inside the wall.
    pub(super) fn is_open(&self, place_m: &Vector2<f64>) -> bool {
        let is_near = 0.0 < place_m.y && place_m.y < self.effects.stand_off_m;
        self.end_m() < place_m.y || (self.wall.is_some() && is_near)
    }

    /// Legs from `antenna_m` to `place_m`: straight, and with 1, 2, .. passes more inside.
    pub(super) fn legs(
        &self,
        antenna_m: &Vector2<f64>,
        place_m: &Vector2<f64>,
    ) -> impl Iterator<Item = Leg> {
        (0..=self.pass_count(place_m)).map(|passes| self.leg(antenna_m, place_m, passes))
    }

    /// How often waves to `place_m` run to and fro inside, at most.
    pub(super) fn pass_count(&self, place_m: &Vector2<f64>) -> usize {
        let crosses = self.wall.is_some() && self.end_m() < place_m.y;
        if crosses { self.effects.inner_pass_count } else { 0 }
    }

    /// The leg from `antenna_m` to `place_m` with that many passes more inside.
    pub(super) fn leg(
        &self,
        antenna_m: &Vector2<f64>,
        place_m: &Vector2<f64>,
        passes: usize,
    ) -> Leg {
        let across_m = place_m - antenna_m;
        match self.wall.filter(|_| self.end_m() < place_m.y) {
            Some(wall) => self.leg_through(&wall, &across_m, passes),
            None => Leg { path_m: across_m.norm(), amplitude: 1.0 },
        }
    }

    fn leg_through(&self, wall: &Wall, across_m: &Vector2<f64>, passes: usize) -> Leg {
        let crossings = (2 * passes + 1) as f64;
        let thick = Wall { thickness_m: crossings * wall.thickness_m, ..*wall };
        let depth_m = across_m.y + thick.thickness_m - wall.thickness_m;
        let path_m = leg_path_m(across_m.x, depth_m, Some(&thick));
        if self.effects.transmission == Transmission::Lossless {
            return Leg { path_m, amplitude: 1.0 };
        }
        let sine = refracted_sine(across_m.x.abs(), depth_m - thick.thickness_m, &thick);
        let face = face_reflection(sine, wall.permittivity);
        let echoed = face.powi(2).powf(passes as f64);
        let amplitude = (1.0 - face * face) * echoed * self.attenuation(&thick, sine);
        Leg { path_m, amplitude }
    }

    /// What is left of an amplitude after a straight way through a slab of that thickness.
    fn attenuation(&self, wall: &Wall, sine: f64) -> f64 {
        let index = wall.permittivity.sqrt();
        let alpha_per_m = 0.5 * self.effects.conductivity_s_per_m * IMPEDANCE_OHM / index;
        let way_m = wall.thickness_m * index / (wall.permittivity - sine * sine).sqrt();
        (-alpha_per_m * way_m).exp()
    }

    /// The amplitude of one straight passage at normal incidence; 1 without loss.
    pub(super) fn normal_amplitude(&self) -> f64 {
        match (self.wall, self.effects.transmission) {
            (Some(wall), Transmission::Fresnel) => {
                let face = face_reflection(0.0, wall.permittivity);
                (1.0 - face * face) * self.attenuation(&wall, 0.0)
            }
            _ => 1.0,
        }
    }

    /// The wall's own echoes from `tx_m` to `rx_m`: front, back, multiples. Antennas that are not
    /// before the wall see none.
    pub(super) fn face_echoes(&self, tx_m: &Vector2<f64>, rx_m: &Vector2<f64>) -> Vec<Leg> {
        let air_m = 2.0 * self.effects.stand_off_m - tx_m.y - rx_m.y;
        let across_m = rx_m.x - tx_m.x;
        let Some(wall) = self.wall.filter(|_| 0.0 < air_m) else { return Vec::new() };
        let echo = |number: usize| {
            if number == 0 {
                let path_m = across_m.hypot(air_m);
                let amplitude = face_reflection(across_m.abs() / path_m, wall.permittivity);
                return Leg { path_m, amplitude };
            }
            let thick = Wall { thickness_m: 2.0 * number as f64 * wall.thickness_m, ..wall };
            let path_m = leg_path_m(across_m, air_m + thick.thickness_m, Some(&thick));
            let sine = refracted_sine(across_m.abs(), air_m, &thick);
            let face = face_reflection(sine, wall.permittivity);
            // An odd number of reflections from within, each of them −r.
            let echoed = -face * face.powi(2).powf(number as f64 - 1.0);
            let amplitude = (1.0 - face * face) * echoed * self.attenuation(&thick, sine);
            Leg { path_m, amplitude }
        };
        (0..self.effects.face_echo_count).map(echo).collect()
    }
}

/// What a face reflects, from the air, of a wave that comes at the sine `sine`.
fn face_reflection(sine: f64, permittivity: f64) -> f64 {
    let cosine = (1.0 - sine * sine).max(0.0).sqrt();
    let inside = (permittivity - sine * sine).max(0.0).sqrt();
    (cosine - inside) / (cosine + inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slab(permittivity: f64, conductivity_s_per_m: f64) -> Slab {
        let effects = WallEffects {
            stand_off_m: 0.5,
            transmission: Transmission::Fresnel,
            conductivity_s_per_m,
            inner_pass_count: 1,
            face_echo_count: 3,
        };
        Slab::new(Some(Wall { thickness_m: 0.24, permittivity }), effects)
    }

    fn db(amplitude: f64) -> f64 {
        20.0 * amplitude.abs().log10()
    }

    #[test]
    fn losses_and_reverberation_are_those_of_real_walls() {
        // spec, research section 4: two ways at normal incidence, and the inner echo of one pass.
        for (permittivity, conductivity, loss_db) in
            [(4.0, 0.02, -9.9), (5.0, 0.03, -13.3), (6.0, 0.05, -19.4), (3.91, 0.026, -12.2)]
        {
            let slab = slab(permittivity, conductivity);
            let (antenna, place) = (Vector2::zeros(), Vector2::new(0.0, 5.0));
            let legs: Vec<Leg> = slab.legs(&antenna, &place).collect();
            let two_ways_db = 2.0 * db(legs[0].amplitude);
            assert!((two_ways_db - loss_db).abs() < 0.3, "{permittivity}: {two_ways_db} dB");
            assert!((db(slab.normal_amplitude()) - db(legs[0].amplitude)).abs() < 1e-9);
            let inner_db = db(legs[1].amplitude / legs[0].amplitude);
            assert!((-31.5..-25.0).contains(&inner_db), "{permittivity}: {inner_db} dB");
            let later_m = legs[1].path_m - legs[0].path_m;
            assert!((later_m - 0.48 * permittivity.sqrt()).abs() < 1e-9);
        }
        // Straight ahead the first leg is what it is without loss, half a metre of air before it.
        let legs: Vec<Leg> =
            slab(4.0, 0.0).legs(&Vector2::zeros(), &Vector2::new(0.0, 5.0)).collect();
        assert!((legs[0].path_m - 5.0 - 0.24).abs() < 1e-12);
        assert!((legs[0].amplitude - 8.0 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn a_slab_without_loss_neither_makes_nor_loses_power() {
        // All echoes and all passages of a pulse shorter than the slab carry its power:
        // r² + Σ ((1 − r²) r^(2m−1))² + Σ ((1 − r²) r^(2m))² = 1.
        let mut lossless = slab(5.0, 0.0);
        lossless.effects.face_echo_count = 8;
        lossless.effects.inner_pass_count = 8;
        for across_m in [0.0, 0.4, 1.1, 2.5] {
            let wide = Vector2::new(across_m, 0.0);
            let echoes = lossless.face_echoes(&Vector2::zeros(), &wide);
            let sine = across_m / across_m.hypot(1.0);
            let face = face_reflection(sine, 5.0);
            assert!((echoes[0].amplitude - face).abs() < 1e-12);
            assert!(across_m <= 0.0 || echoes[0].amplitude < face_reflection(0.0, 5.0));
            assert!(echoes[1].amplitude > 0.0, "the back face turns the sign over");
        }
        let echoed: f64 = lossless
            .face_echoes(&Vector2::zeros(), &Vector2::zeros())
            .iter()
            .map(|echo| echo.amplitude.powi(2))
            .sum();
        let passed: f64 = lossless
            .legs(&Vector2::zeros(), &Vector2::new(0.0, 3.0))
            .map(|leg| leg.amplitude.powi(2))
            .sum();
        assert!((echoed + passed - 1.0).abs() < 1e-6, "{echoed} and {passed}");
    }

    #[test]
    fn nonsense_is_named() {
        let good = slab(5.0, 0.03).effects;
        assert_eq!(good.check(), Ok(()));
        let field = |effects: WallEffects| effects.check().unwrap_err().field;
        let of = |name: &str| format!("scene.wall_effects.{name}");
        assert_eq!(field(WallEffects { stand_off_m: -1.0, ..good }), of("stand_off_m"));
        assert_eq!(field(WallEffects { stand_off_m: 0.0, ..good }), of("stand_off_m"));
        let metal = WallEffects { conductivity_s_per_m: f64::NAN, ..good };
        assert_eq!(field(metal), of("conductivity_s_per_m"));
        let many = WallEffects { inner_pass_count: 9, ..good };
        assert_eq!(field(many), of("inner_pass_count"));
        let clear = WallEffects { transmission: Transmission::Lossless, ..good };
        assert_eq!(field(clear), of("inner_pass_count"));
        let echo = WallEffects { inner_pass_count: 0, ..clear };
        assert_eq!(field(echo), of("face_echo_count"));
    }
}
