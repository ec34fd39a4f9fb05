//! Whether a frame makes sense.

use proto::radar::Grid;

use crate::tracking::{Frame, FrameError};

/// Checks a frame against the time of the one before (`-inf` if there was none).
///
/// # Errors
/// If the time does not ascend, the image has not one value per pixel of its grid, or a number is
/// none, negative where it must not be, or infinite.
pub fn check_frame(frame: &Frame<'_>, previous_s: f64) -> Result<(), FrameError> {
    let Frame { time_s, amplitude, .. } = *frame;
    let wrong = |what| Err(FrameError::NotFinite { time_s, what });
    if !time_s.is_finite() {
        return wrong("the time");
    }
    if time_s <= previous_s {
        return Err(FrameError::TimeNotAscending { time_s, previous_s });
    }
    let Grid { x_min_m, y_min_m, pixel_m, column_count, row_count } = frame.grid;
    let want = column_count.saturating_mul(row_count);
    if amplitude.len() != want {
        return Err(FrameError::PixelCount { time_s, got: amplitude.len(), want });
    }
    if !(x_min_m.is_finite() && y_min_m.is_finite() && pixel_m.is_finite() && 0.0 < pixel_m) {
        return wrong("the grid");
    }
    if !is_amplitude(frame.noise_amplitude) {
        return wrong("the noise");
    }
    // Without an early end: that is what lets a compiler look at eight at a time.
    let bad_count: u32 = amplitude.iter().map(|value| u32::from(!is_amplitude(*value))).sum();
    if 0 < bad_count { wrong("a pixel") } else { Ok(()) }
}

fn is_amplitude(value: f32) -> bool {
    (0.0..=f32::MAX).contains(&value)
}
