//! Points, Gaussians and rigid motions of the plane, with the frame in the type.
//!
//! A node's frame has its origin at the array centre, `x` along the array to the right when
//! looking along boresight, `y` along boresight. `Ref` is the frame of the reference node. Angles
//! are counter-clockwise in radians, lengths in metres.

mod errors;
mod point;
mod se2;

pub use errors::{ByBoth, carried_by_pose, point_by_pose, squared_length};
pub use point::{Gaussian, Point, principal_axes};
pub use se2::{Se2, Tangent, wrap_angle};

/// A kind of coordinate frame. Which node a [`Node`] frame belongs to is said by the record that
/// holds it, not by the type.
pub trait Frame: Copy + std::fmt::Debug + Send + Sync + 'static {}

/// The frame of one radar node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node;

/// The common frame: that of the reference node when the centre started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ref;

/// The frame of a simulated scene or a surveyed room, in which truth is stated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct World;

impl Frame for Node {}
impl Frame for Ref {}
impl Frame for World {}
