//! One bounce over the links: pull, gather, push.
//!
//! Based on: Hanrahan, Salzman, Aupperle, 1991 (push/pull); Smits, Arvo, Greenberg, 1994 (through clusters).

use crate::hierarchy::Hierarchy;
use crate::scene::Rgb;
use crate::transport::Links;
use rayon::prelude::*;

/// Balancing steps at most.
const CLOSURE_STEPS: usize = 24;
/// A closure factor stays within this and its inverse: what asks for more is unlinked, not badly linked.
const CLOSURE_LIMIT: f32 = 4.0;

/// Area-weighted mean per node of what elements hold. Keeps ΣA·B.
pub fn pull(tree: &Hierarchy, elements: &[Rgb]) -> Vec<Rgb> {
    let mut nodes = vec![Rgb::ZERO; tree.nodes.len()];
    for (e, &value) in tree.elements.iter().zip(elements) {
        nodes[e.node as usize] = value;
    }
    for n in (0..tree.nodes.len() as u32).rev() {
        if tree.is_leaf(n) {
            continue;
        }
        let (mut sum, mut area) = (Rgb::ZERO, 0.0);
        for c in tree.children(n) {
            let a = tree.nodes[c as usize].area;
            sum += nodes[c as usize] * a;
            area += a;
        }
        nodes[n as usize] = sum / area.max(f32::MIN_POSITIVE);
    }
    nodes
}

/// Irradiance per element when every element sends `radiosity`, W/m².
pub fn transfer(tree: &Hierarchy, links: &Links, radiosity: &[Rgb]) -> Vec<Rgb> {
    let sources = pull(tree, radiosity);
    let mut nodes: Vec<Rgb> = (0..tree.nodes.len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .map(|n| links.of(n).iter().map(|l| sources[l.source as usize] * l.weight()).sum())
        .collect();
    // Push: depth-first order meets a parent before its children.
    for n in 0..tree.nodes.len() as u32 {
        let e = nodes[n as usize];
        for c in tree.children(n) {
            nodes[c as usize] += e;
        }
    }
    tree.elements.iter().map(|e| nodes[e.node as usize]).collect()
}

/// How much each element counts at the two ends of its links.
#[derive(Clone, Debug, Default)]
pub struct Closure {
    /// Factor on what an element sends.
    pub sending: Vec<f32>,
    /// Factor on what it receives.
    pub receiving: Vec<f32>,
}

/// Factors that make the links of every element account for `seen`, the share of its view that is filled by surfaces
/// as counted by rays. Where the balance is reached both factors are the same, so that reciprocity is kept and energy
/// balances exactly; elsewhere reception is cut, so that nothing ever receives more than it can see.
pub fn closure(tree: &Hierarchy, links: &Links, seen: &[f32]) -> Closure {
    let mut sending = vec![1f32; seen.len()];
    for _ in 0..CLOSURE_STEPS {
        let received = received(tree, links, &sending);
        let mut worst = 0f32;
        for ((s, e), &seen) in sending.iter_mut().zip(&received).zip(seen) {
            let linked = *s * e;
            if linked > 0.0 {
                let next = (*s * (seen / linked).sqrt()).clamp(1.0 / CLOSURE_LIMIT, CLOSURE_LIMIT);
                worst = worst.max((next - *s).abs());
                *s = next;
            }
        }
        if worst < 1e-4 {
            break;
        }
    }
    let received = received(tree, links, &sending);
    let receiving = sending
        .iter()
        .zip(&received)
        .zip(seen)
        .map(|((&s, &e), &seen)| if s * e > seen { seen / e } else { s })
        .collect();
    Closure { sending, receiving }
}

/// Irradiance per element when every element sends its factor.
fn received(tree: &Hierarchy, links: &Links, sending: &[f32]) -> Vec<f32> {
    let sent: Vec<Rgb> = sending.iter().map(|&s| Rgb::splat(s)).collect();
    transfer(tree, links, &sent).into_iter().map(|e| e.x).collect()
}
