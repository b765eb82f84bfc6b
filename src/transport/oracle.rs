//! Refinement oracles: at which level do two nodes interact?

use crate::hierarchy::{Hierarchy, Node};
use crate::scene::Rgb;

/// What to do with a pair of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Link them.
    Accept,
    /// Go on with the children of the first node.
    SplitReceiver,
    /// Go on with the children of the second node.
    SplitSource,
}

/// What is known of a pair when the oracle is asked.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Mean kernel, 1/m².
    pub kernel: f32,
    /// Its standard deviation over the pairs of points.
    pub deviation: f32,
    /// Unblocked share, once rays were cast.
    pub visibility: Option<f32>,
}

/// Decides for a pair `(receiver, source)`; the exchange is symmetric, so both directions matter.
pub trait Oracle: Sync {
    /// The decision; never asks to split where links end.
    fn decide(&self, hierarchy: &Hierarchy, receiver: u32, source: u32, estimate: &Estimate) -> Decision;
}

/// Splits while the irradiance that the link may get wrong exceeds a budget.
///
/// Based on: Lischinski, Smits, Greenberg, "Bounds and Error Estimates for Radiosity", 1994: the error of a link is
/// its source's radiosity times the spread of the kernel over it.
pub struct ErrorOracle<'a> {
    /// Largest error of one link, W/m².
    pub epsilon: f32,
    /// Estimated radiosity per node.
    pub radiosity: &'a [Rgb],
    /// Deviation of the radiosity inside each node, W/m².
    pub variation: &'a [f32],
}

impl ErrorOracle<'_> {
    /// Irradiance error at nodes of area `source.area` with the kernel error `kernel`.
    fn error(&self, source: u32, area: f32, kernel_error: f32, kernel: f32) -> f32 {
        let s = source as usize;
        area * (self.radiosity[s].max_element() * kernel_error + self.variation[s] * kernel)
    }
}

impl Oracle for ErrorOracle<'_> {
    fn decide(&self, hierarchy: &Hierarchy, receiver: u32, source: u32, estimate: &Estimate) -> Decision {
        let (r, s) = (&hierarchy.nodes[receiver as usize], &hierarchy.nodes[source as usize]);
        let (end_r, end_s) = (hierarchy.is_link_end(receiver), hierarchy.is_link_end(source));
        if end_r && end_s {
            return Decision::Accept;
        }
        let visibility = estimate.visibility.unwrap_or(1.0);
        // Penumbrae: half seen is the worst that one number can say of many receivers.
        let blocked = 2.0 * estimate.kernel * (visibility * (1.0 - visibility)).sqrt();
        let spread = if overlap(r, s) { f32::INFINITY } else { estimate.deviation * visibility + blocked };
        let kernel = estimate.kernel * visibility;
        let error = self.error(source, s.area, spread, kernel).max(self.error(receiver, r.area, spread, kernel));
        if error.is_nan() || error <= self.epsilon {
            return Decision::Accept;
        }
        let split_receiver = if end_r || end_s { end_s } else { r.radius() >= s.radius() };
        if split_receiver { Decision::SplitReceiver } else { Decision::SplitSource }
    }
}

/// True if the bounding spheres are so close that the kernel is unbounded.
fn overlap(a: &Node, b: &Node) -> bool {
    a.centre().distance(b.centre()) < a.radius() + b.radius()
}
