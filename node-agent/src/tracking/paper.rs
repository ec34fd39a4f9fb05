//! The published tracker: templates by two-axis projection, mean shift, M of N \[mean-shift\].
//!
//! Of every frame: each track goes by mean shift from where it was to where the image looks like
//! its template; then maxima, largest first, become templates unless they lie in one; a template in
//! which or on which a track stands renews it, any other one starts a track. A track is updated
//! if its place changed; it is confirmed if that was so in more than `M` of the last `N` frames, and
//! ends after `M_s` frames without.
//!
//! Where the text leaves a choice. What counts as noise is a multiple of the noise in the image,
//! and what is large is a share of the frame's maximum. Whether templates are renewed is not said;
//! the ellipse "of changing size" that is drawn around people asks for it. Two tracks on one place
//! compete: the older one takes it, and the other is not updated. Velocity, which the paper does not
//! estimate, is the difference of two places, and the covariance that of their stated errors, with
//! the errors of different frames taken as independent, which they are not quite.
//!
//! A frame with another grid starts anew; ids go on.

use proto::radar::Grid;

use crate::imaging::InvalidSetting;

use super::histogram::Bins;
use super::maxima::{Disc, Keep, Peak, Raster, largest, maxima_into};
use super::shift::{ShiftRule, Template, shift};
use super::template::{Ellipse, Growth, grown};
use super::{Frame, FrameError, Track, Tracker};

mod check;
mod config;
mod followed;

pub use check::check_frame;
pub use config::{PaperConfig, Renewal};

use followed::{Followed, Place};

/// The published tracker with what it knows; memory is bounded by its settings.
#[derive(Clone, Debug)]
pub struct PaperTracker {
    config: PaperConfig,
    /// The pixels of the frame before, and what follows from their size.
    scale: Option<Scale>,
    previous_s: f64,
    next_id: u64,
    followed: Vec<Followed>,
    peaks: Vec<Peak>,
    /// The templates of this frame.
    templates: Vec<Ellipse>,
    tracks: Vec<Track>,
}

/// Settings in pixels.
#[derive(Clone, Debug)]
struct Scale {
    grid: Grid,
    disc: Disc,
    rule: ShiftRule,
    max_counts: [usize; 2],
}

impl PaperTracker {
    /// A tracker that has seen nothing.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn new(config: &PaperConfig) -> Result<Self, InvalidSetting> {
        config.check()?;
        Ok(Self {
            config: *config,
            scale: None,
            previous_s: f64::NEG_INFINITY,
            next_id: 1,
            followed: Vec::with_capacity(config.max_track_count),
            peaks: Vec::with_capacity(config.max_peak_count + 1),
            templates: Vec::with_capacity(config.max_peak_count),
            tracks: Vec::with_capacity(config.max_track_count),
        })
    }

    /// Starts anew if the pixels are others than before.
    fn use_grid(&mut self, grid: &Grid) {
        if self.scale.as_ref().is_some_and(|scale| scale.grid == *grid) {
            return;
        }
        self.followed.clear();
        self.scale = Some(Scale {
            grid: *grid,
            disc: Disc::new(self.config.disc_half_m.map(|half_m| half_m / grid.pixel_m)),
            rule: self.config.rule(grid.pixel_m),
            max_counts: self.config.max_counts(grid.pixel_m),
        });
    }

    /// Moves every track to where the image looks like its template, older ones first.
    fn shift_all(&mut self, raster: &Raster<'_>, rule: &ShiftRule, place: &Place) {
        for index in 0..self.followed.len() {
            let (older, rest) = self.followed.split_at_mut(index);
            let Some(track) = rest.first_mut() else { return };
            let free = shift(raster, &track.template, track.centre_px, rule).filter(|shifted| {
                older.iter().all(|other| 1.0 <= other.ellipse().distance2(&shifted.centre_px))
            });
            track.take(free.as_ref(), place);
        }
    }

    /// Renews the templates of tracks and starts new ones at maxima where nobody is followed.
    fn look_around(&mut self, raster: &Raster<'_>, level: &Level, place: &Place) {
        let Some(scale) = &self.scale else { return };
        let keep = Keep { above: level.peak, max_count: self.config.max_peak_count };
        maxima_into(raster, &scale.disc, keep, &mut self.peaks);
        let growth = Growth {
            line_share: self.config.line_share,
            floor: level.floor,
            max_counts: scale.max_counts,
        };
        self.templates.clear();
        for index in 0..self.peaks.len() {
            let peak = self.peaks[index];
            let peak_px = peak.place_px();
            if self.templates.iter().all(|known| 1.0 <= known.distance2(&peak_px)) {
                let ellipse = grown(raster, &peak, &growth).inner_ellipse();
                self.templates.push(ellipse);
                self.give(raster, &peak, &ellipse, (level, place));
            }
        }
    }

    /// Gives the template of a maximum to the track that it belongs to, or starts one with it.
    fn give(
        &mut self,
        raster: &Raster<'_>,
        peak: &Peak,
        ellipse: &Ellipse,
        (level, place): (&Level, &Place),
    ) {
        let bins =
            Bins { count: self.config.bin_count, top: peak.amplitude, floor: level.bin_floor };
        let Some(template) = Template::new(raster, ellipse, bins) else { return };
        let is_owner = |track: &&mut Followed| {
            let stands_in_it = ellipse.distance2(&track.centre_px) < 1.0;
            stands_in_it || track.ellipse().distance2(&peak.place_px()) < 1.0
        };
        if let Some(owner) = self.followed.iter_mut().find(is_owner) {
            if self.config.renewal == Renewal::EveryFrame {
                owner.template = template;
            }
        } else if self.followed.len() < self.config.max_track_count {
            self.followed.push(Followed::new(self.next_id, template, ellipse.centre_px, place));
            self.next_id += 1;
        }
    }
}

/// Amplitudes that count.
struct Level {
    /// Maxima are larger.
    peak: f32,
    /// Smaller ones count as nothing when a template grows.
    floor: f32,
    /// Smaller ones go to the first bin.
    bin_floor: f32,
}

impl Tracker for PaperTracker {
    fn track(&mut self, frame: &Frame<'_>) -> Result<&[Track], FrameError> {
        check_frame(frame, self.previous_s)?;
        self.previous_s = frame.time_s;
        self.use_grid(&frame.grid);
        let Grid { column_count, row_count, .. } = frame.grid;
        let raster = Raster { amplitude: frame.amplitude, column_count, row_count };
        let place = Place { time_s: frame.time_s, grid: frame.grid, config: self.config };
        let PaperConfig { noise_factor, peak_fraction, floor_factor, bin_floor_factor, .. } =
            self.config;
        let of_noise = |factor: f64| crate::imaging::single(factor) * frame.noise_amplitude;
        let of_peak = crate::imaging::single(peak_fraction) * largest(frame.amplitude);
        let level = Level {
            peak: of_noise(noise_factor).max(of_peak),
            floor: of_noise(floor_factor),
            bin_floor: of_noise(bin_floor_factor),
        };
        if let Some(rule) = self.scale.as_ref().map(|scale| scale.rule) {
            self.shift_all(&raster, &rule, &place);
        }
        let end_count = self.config.end_count;
        self.followed.retain(|track| track.missed_count < end_count);
        self.look_around(&raster, &level, &place);
        self.tracks.clear();
        self.tracks.extend(self.followed.iter().map(|track| track.seen(&place)));
        Ok(&self.tracks)
    }
}

#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
