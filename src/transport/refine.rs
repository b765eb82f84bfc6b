//! Link refinement: decides at which level receiver and source interact.
//!
//! Based on: Hanrahan, Salzman, Aupperle, "A Rapid Hierarchical Radiosity Algorithm", 1991; Sillion, "Hierarchical
//! Solution Techniques for Realistic Rendering", 1995 (clusters as nodes of one hierarchy).

use super::{Decision, Estimate, Exchange, Links, Oracle};
use crate::hierarchy::Node;
use crate::progress::{Cancelled, Counter, Progress, Stage};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::f32::consts::FRAC_PI_2;
use std::sync::atomic::{AtomicU64, Ordering};

/// How links are made.
#[derive(Clone, Copy, Debug)]
pub struct RefineSettings {
    /// Pairs of points for the kernel of a link.
    pub kernel_samples: u32,
    /// Rays of a link that matters little.
    pub rays: u32,
    /// Rays of a link between two of the smallest nodes.
    pub rays_between_ends: u32,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { kernel_samples: 16, rays: 4, rays_between_ends: 8 }
    }
}

/// Pairs that are enough to keep all threads busy.
const TASKS: usize = 2048;

type Pair = (u32, u32);
/// Two nodes, mean kernel in 1/m², visibility.
type Accepted = (u32, u32, f32, f32);

/// What becomes of a pair.
enum Step {
    /// They cannot see each other.
    Nothing,
    Link(Accepted),
    Split(Vec<Pair>),
}

/// Links every part of the scene to every other at the level that `oracle` chooses. Returns the links and the number
/// of rays cast. The result does not depend on the number of threads.
pub fn refine(
    exchange: &Exchange,
    oracle: &dyn Oracle,
    settings: &RefineSettings,
    progress: &dyn Progress,
) -> Result<(Links, u64), Cancelled> {
    let rays = AtomicU64::new(0);
    let refiner = Refiner { exchange, oracle, settings, rays: &rays };
    let mut accepted = Vec::new();
    let mut queue = VecDeque::new();
    if !exchange.hierarchy.nodes.is_empty() {
        queue.push_back((0, 0));
    }
    while queue.len() < TASKS {
        let Some(pair) = queue.pop_front() else { break };
        match refiner.step(pair) {
            Step::Nothing => {}
            Step::Link(link) => accepted.push(link),
            Step::Split(pairs) => queue.extend(pairs),
        }
    }
    let counter = Counter::new(progress, Stage::Solve, queue.len());
    let parts: Vec<Vec<Accepted>> = Vec::from(queue)
        .into_par_iter()
        .map(|pair| {
            let mut out = Vec::new();
            let mut stack = vec![pair];
            while let Some(pair) = stack.pop() {
                match refiner.step(pair) {
                    Step::Nothing => {}
                    Step::Link(link) => out.push(link),
                    Step::Split(pairs) => stack.extend(pairs),
                }
                if progress.is_cancelled() {
                    return Err(Cancelled);
                }
            }
            counter.advance(1)?;
            Ok(out)
        })
        .collect::<Result<_, Cancelled>>()?;
    accepted.extend(parts.into_iter().flatten());
    let areas: Vec<f32> = exchange.hierarchy.nodes.iter().map(|n| n.area).collect();
    Ok((Links::from_exchanges(&areas, &accepted), rays.into_inner()))
}

struct Refiner<'a> {
    exchange: &'a Exchange<'a>,
    oracle: &'a dyn Oracle,
    settings: &'a RefineSettings,
    rays: &'a AtomicU64,
}

impl Refiner<'_> {
    fn step(&self, (a, b): Pair) -> Step {
        let tree = self.exchange.hierarchy;
        if a == b {
            // What the parts of the smallest nodes exchange, closure adds to the other links.
            if tree.is_link_end(a) {
                return Step::Nothing;
            }
            let children: Vec<u32> = tree.children(a).collect();
            let pairs = children.iter().enumerate().flat_map(|(i, &x)| children[i..].iter().map(move |&y| (x, y)));
            return Step::Split(pairs.collect());
        }
        let (na, nb) = (&tree.nodes[a as usize], &tree.nodes[b as usize]);
        if faces_away(na, nb) || faces_away(nb, na) {
            return Step::Nothing;
        }
        let kernel = self.exchange.kernel(a, b, self.settings.kernel_samples);
        let mut estimate = Estimate { kernel: kernel.mean, deviation: kernel.deviation, visibility: None };
        if let Some(split) = self.split(a, b, &estimate) {
            return split;
        }
        if kernel.mean <= 0.0 {
            return Step::Nothing;
        }
        let ends = tree.is_link_end(a) && tree.is_link_end(b);
        let rays = if ends { self.settings.rays_between_ends } else { self.settings.rays };
        let Some((visibility, cast)) = self.exchange.visibility(a, b, rays) else { return Step::Nothing };
        self.rays.fetch_add(cast as u64, Ordering::Relaxed);
        estimate.visibility = Some(visibility);
        if let Some(split) = self.split(a, b, &estimate) {
            return split;
        }
        if visibility > 0.0 { Step::Link((a, b, kernel.mean, visibility)) } else { Step::Nothing }
    }

    fn split(&self, a: u32, b: u32, estimate: &Estimate) -> Option<Step> {
        let tree = self.exchange.hierarchy;
        match self.oracle.decide(tree, a, b, estimate) {
            Decision::Accept => None,
            Decision::SplitReceiver => Some(Step::Split(tree.children(a).map(|c| (c, b)).collect())),
            Decision::SplitSource => Some(Step::Split(tree.children(b).map(|c| (a, c)).collect())),
        }
    }
}

/// True if no point of `b` lies above the horizon of any point of `a`, by normal cone and bounding spheres.
fn faces_away(a: &Node, b: &Node) -> bool {
    let v = b.centre() - a.centre();
    let distance = v.length();
    let reach = a.radius() + b.radius();
    if distance <= reach {
        return below_plane(a, b);
    }
    let angle = (a.axis.dot(v) / distance).clamp(-1.0, 1.0).acos();
    angle - a.cone - (reach / distance).asin() > FRAC_PI_2
}

/// For a flat `a`: true if the box of `b` lies on or behind its plane.
fn below_plane(a: &Node, b: &Node) -> bool {
    if a.cone > 1e-3 {
        return false;
    }
    let half = (b.high - b.low) * 0.5;
    let plane_half = (a.high - a.low) * 0.5;
    let reach = half.dot(a.axis.abs()) + plane_half.dot(a.axis.abs());
    a.axis.dot(b.centre() - a.centre()) + reach <= 1e-5 * (reach + half.length())
}
