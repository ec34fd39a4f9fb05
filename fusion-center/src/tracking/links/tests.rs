//! Counts worked out by hand.

use nalgebra::{Matrix4, Vector4};

use super::*;

/// One look per second, reports numbered by hand.
fn step(track: u64, look_index: u64, report_index: Option<u32>) -> Settled {
    let report = |index| ReportId { sensor_index: 0, look_index, report_index: index };
    Settled {
        track,
        status: Status::Confirmed,
        time_s: look_index as f64,
        state: Vector4::zeros(),
        covariance: Matrix4::identity(),
        smoothed_state: Vector4::zeros(),
        smoothed_covariance: Matrix4::identity(),
        report: report_index.map(report),
        share: 1.0,
    }
}

/// Track `track` with the reports of consecutive looks.
fn track(track: u64, reports: &[Option<u32>]) -> Vec<Settled> {
    let steps = reports.iter().zip(0..);
    steps.map(|(report, look_index)| step(track, look_index, *report)).collect()
}

/// Reports 1, 2, 3 are of the targets of these numbers, report 9 is of none.
fn target(report: ReportId) -> Option<u32> {
    (report.report_index != 9).then_some(report.report_index)
}

#[test]
fn a_swap_costs_one_link_in_each_track_and_the_rest_of_the_identity() {
    let mut steps = track(5, &[Some(1), Some(1), Some(2), Some(2), Some(2)]);
    steps.extend(track(6, &[Some(2), Some(2), Some(1), Some(1), Some(1)]));
    let counts = links(&steps, Origin::First, target);
    let by_hand = Links {
        track_count: 2,
        update_count: 10,
        clutter_count: 0,
        link_count: 8,
        right_link_count: 6,
        identity_count: 4,
        pure_count: 6,
        target_count: 2,
        switch_count: 2,
    };
    assert_eq!(counts, by_hand);
    assert_eq!(counts.right_link_rate(), Some(0.75));
    assert_eq!(counts.identity_rate(), Some(0.4));
    assert_eq!(counts.purity(), Some(0.6));
}

#[test]
fn links_bridge_misses_and_clutter_breaks_them() {
    let counts =
        links(&track(1, &[Some(1), None, Some(1), Some(9), Some(9)]), Origin::First, target);
    assert_eq!((counts.update_count, counts.clutter_count), (4, 2));
    assert_eq!((counts.link_count, counts.right_link_count), (3, 1));
    assert_eq!((counts.identity_count, counts.pure_count), (2, 2));
    assert_eq!(counts.switch_count, 0);
}

#[test]
fn a_track_of_clutter_is_of_nobody() {
    let counts = links(&track(1, &[Some(9), Some(9), Some(1)]), Origin::First, target);
    assert_eq!((counts.link_count, counts.right_link_count), (2, 0));
    assert_eq!((counts.identity_count, counts.pure_count), (0, 1));
}

#[test]
fn the_origin_is_the_first_update_or_the_first_majority() {
    let steps = track(1, &[Some(2), Some(1), Some(1), Some(1), Some(2)]);
    let identity = |origin| links(&steps, origin, target).identity_count;
    assert_eq!(identity(Origin::First), 2);
    assert_eq!(identity(Origin::MajorityOf(0)), 2);
    assert_eq!(identity(Origin::MajorityOf(2)), 2, "the earlier one of equals");
    assert_eq!(identity(Origin::MajorityOf(3)), 3);
    assert_eq!(identity(Origin::MajorityOf(100)), 3);
}

#[test]
fn two_tracks_on_one_target_share_it_without_switches() {
    let mut steps = track(1, &[Some(1), Some(1), Some(1), Some(2)]);
    steps.extend(track(2, &[Some(2), Some(1), Some(1), Some(1)]));
    let counts = links(&steps, Origin::First, target);
    // Target 1 stays with track 1 as long as that has it, then passes to track 2; target 2 passes
    // from track 2 to track 1.
    assert_eq!((counts.target_count, counts.switch_count), (2, 2));
    assert_eq!((counts.link_count, counts.right_link_count), (6, 4));
}

#[test]
fn a_target_that_is_lost_and_found_by_another_track_is_one_switch() {
    let mut steps = track(1, &[Some(1), Some(1)]);
    steps.extend([4, 5].map(|look_index| step(2, look_index, Some(1))));
    let counts = links(&steps, Origin::First, target);
    assert_eq!((counts.track_count, counts.switch_count), (2, 1));
    assert_eq!((counts.link_count, counts.right_link_count), (2, 2));
}

#[test]
fn tracks_never_confirmed_are_left_out_with_all_their_steps() {
    let mut steps = track(1, &[Some(1), Some(1), Some(1)]);
    steps[0].status = Status::Tentative;
    steps[2].status = Status::Coasting;
    let mut tentative = track(2, &[Some(2), Some(2)]);
    tentative.iter_mut().for_each(|step| step.status = Status::Tentative);
    steps.extend(tentative);
    let kept = of_confirmed(&steps);
    assert_eq!(kept, steps[..3]);
}

#[test]
fn runs_add_up_and_nothing_has_no_rate() {
    let runs = [track(1, &[Some(1), Some(1)]), track(1, &[Some(1), Some(2), Some(2)])];
    let sum: Links = runs.iter().map(|steps| links(steps, Origin::First, target)).sum();
    assert_eq!((sum.track_count, sum.update_count, sum.link_count), (2, 5, 3));
    assert_eq!((sum.right_link_count, sum.identity_count, sum.pure_count), (2, 3, 4));
    assert_eq!((sum.target_count, sum.switch_count), (3, 0));
    let nothing = links(&[], Origin::First, target);
    assert_eq!(nothing, Links::default());
    assert_eq!(
        (nothing.right_link_rate(), nothing.identity_rate(), nothing.purity()),
        (None, None, None)
    );
}
