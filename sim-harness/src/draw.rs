//! Pictures of a run: everybody's points before and after registration
//! \[registration, figure 5\].

use anyhow::anyhow;
use chart::{Sheet, color};
use fusion_center::offline::{Layer, Site, Way};
use proto::geom::{Node, Point, Ref, Se2};
use proto::wire::PoseRecord;

use crate::observe::{Fused, Person};
use crate::report::{NodePoints, Report};

/// Each node's points in its own frame, as if all frames were one.
pub(crate) fn before(report: &Report, points: &NodePoints) -> anyhow::Result<String> {
    let layers = layers(report, |index| Layer {
        label: report.nodes[index].node.to_string(),
        color: color(index),
        points_m: points.get(&report.nodes[index].node).cloned().unwrap_or_default(),
        estimated: (index == 0).then(Se2::identity),
        truth: None,
        ways: Vec::new(),
    });
    draw(format!("{}: before registration, each node in its own frame", report.scenario), layers)
}

/// All points in the common frame, with the nodes' estimated and true places.
pub(crate) fn after(report: &Report, points: &NodePoints) -> anyhow::Result<String> {
    let mut layers = layers(report, |index| {
        let node = &report.nodes[index];
        let estimated: Option<Se2<Ref, Node>> = node.pose_ref_from_node.map(PoseRecord::into);
        let own = points.get(&node.node).map_or(&[][..], Vec::as_slice);
        let placed = estimated.map_or_else(Vec::new, |pose_ref_from_node| {
            let place = |[x_m, y_m]: &[f64; 2]| {
                let point_in_ref = pose_ref_from_node * Point::<Node>::new(*x_m, *y_m);
                [point_in_ref.x_m(), point_in_ref.y_m()]
            };
            own.iter().map(place).collect()
        });
        let state = if estimated.is_some() { "" } else { " (not registered)" };
        Layer {
            label: format!("{}{state}", node.node),
            color: color(index),
            points_m: placed,
            estimated,
            truth: Some(node.truth.into()),
            ways: ways(report, index),
        }
    });
    layers.extend(together(report));
    draw(format!("{}: after registration, frame of {}", report.scenario, report.reference), layers)
}

/// The ways of the people whom the centre followed by all nodes together, with their ids.
fn together(report: &Report) -> Option<Layer> {
    let color = color(report.nodes.len());
    let way = |person: &Fused| Way {
        color,
        label: person.last.id.to_string(),
        places_m: person.places_m.clone(),
    };
    (!report.fused.is_empty()).then(|| Layer {
        label: "all together".to_owned(),
        color,
        points_m: Vec::new(),
        estimated: None,
        truth: None,
        ways: report.fused.iter().map(way).collect(),
    })
}

/// The ways of the people whom a node followed, with their ids.
fn ways(report: &Report, index: usize) -> Vec<Way> {
    let node = &report.nodes[index].node;
    let own = report.people.iter().filter(|person| person.last.node == *node);
    let way = |person: &Person| {
        let label = person.last.track.id.to_string();
        Way { label, color: color(index), places_m: person.places_m.clone() }
    };
    own.map(way).collect()
}

fn layers(report: &Report, layer: impl Fn(usize) -> Layer) -> Vec<Layer> {
    (0..report.nodes.len()).map(layer).collect()
}

fn draw(title: String, layers: Vec<Layer>) -> anyhow::Result<String> {
    let site = Site { title, layers };
    site.svg().map_err(|error| anyhow!("drawing {}: {error}", site.title))
}
