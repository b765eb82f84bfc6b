//! The coarse radiosity solution: multi-bounce irradiance of every element, as a source for the final gather.

mod survey;
mod transfer;

pub use survey::{Survey, hidden_backs, survey};
pub use transfer::{Closure, closure, pull, transfer};

use crate::hierarchy::Hierarchy;
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Rgb;
use crate::transport::{ErrorOracle, Exchange, Links, RefineSettings, refine};
use rayon::prelude::*;

/// How the coarse solution is found.
#[derive(Clone, Copy, Debug)]
pub struct SolveSettings {
    /// Largest error of one link, relative to the mean irradiance.
    pub link_error: f32,
    /// Relative change of the total radiosity at which iteration ends.
    pub convergence: f32,
    /// Most iterations.
    pub iterations: u32,
    /// How links are made.
    pub refine: RefineSettings,
}

impl SolveSettings {
    /// Settings whose part in a relative error of the lightmap is small.
    pub fn for_error(error: f32) -> Self {
        Self { link_error: error, convergence: 0.002 * error, iterations: 300, refine: RefineSettings::default() }
    }
}

/// What every element reflects and sends before any exchange.
pub struct Elements {
    /// Mean diffuse reflectance.
    pub reflectance: Vec<Rgb>,
    /// Own emission (that is not sent by lamps) as radiosity, W/m².
    pub emittance: Vec<Rgb>,
    /// Irradiance straight from lamps, W/m².
    pub direct: Vec<Rgb>,
}

/// The coarse solution.
pub struct Solution {
    /// Links between nodes.
    pub links: Links,
    /// Factors that make the links of every element account for all that it sees.
    pub closure: Closure,
    /// Irradiance per element from everything but lamps: sky and other elements, W/m².
    pub irradiance: Vec<Rgb>,
    /// Iterations until convergence.
    pub iterations: u32,
    /// Visibility rays cast for links.
    pub rays: u64,
}

/// Refines links and iterates to convergence.
pub fn solve(
    exchange: &Exchange,
    elements: &Elements,
    survey: &Survey,
    settings: &SolveSettings,
    progress: &dyn Progress,
) -> Result<Solution, Cancelled> {
    let tree = exchange.hierarchy;
    let first = first_radiosity(elements, &survey.sky);
    let (epsilon, estimate) = estimate(tree, elements, survey, &first, settings.link_error);
    let radiosity = pull(tree, &estimate);
    let variation = variation(tree, &estimate, &radiosity);
    let oracle = ErrorOracle { epsilon, radiosity: &radiosity, variation: &variation };
    let (links, rays) = refine(exchange, &oracle, &settings.refine, progress)?;
    let closure = closure(tree, &links, &survey.lit);
    let (mut irradiance, iterations) = iterate(tree, &links, &closure, elements, &first, settings, progress)?;
    for (e, sky) in irradiance.iter_mut().zip(&survey.sky) {
        *e += *sky;
    }
    Ok(Solution { links, closure, irradiance, iterations, rays })
}

impl Solution {
    /// Irradiance per element from everything but lamps if other light is sent over the same links, W/m²: that of
    /// `elements`, and `sky` W/m² per element. Reflectances stay those of the solution.
    pub fn of_other_light(
        &self,
        tree: &Hierarchy,
        elements: &Elements,
        sky: &[Rgb],
        settings: &SolveSettings,
        progress: &dyn Progress,
    ) -> Result<Vec<Rgb>, Cancelled> {
        let first = first_radiosity(elements, sky);
        let (mut irradiance, _) = iterate(tree, &self.links, &self.closure, elements, &first, settings, progress)?;
        irradiance.iter_mut().zip(sky).for_each(|(e, &sky)| *e += sky);
        Ok(irradiance)
    }
}

/// Radiosity of elements before any exchange, W/m².
fn first_radiosity(elements: &Elements, sky: &[Rgb]) -> Vec<Rgb> {
    (0..elements.direct.len())
        .map(|i| elements.emittance[i] + elements.reflectance[i] * (elements.direct[i] + sky[i]))
        .collect()
}

/// Error budget of a link in W/m², and a guess at the radiosity of elements with all bounces: the first one plus a
/// constant irradiance that balances what is emitted, absorbed and lost.
fn estimate(tree: &Hierarchy, elements: &Elements, survey: &Survey, first: &[Rgb], link_error: f32) -> (f32, Vec<Rgb>) {
    let area = |i: usize| tree.nodes[tree.elements[i].node as usize].area;
    let (mut total, mut sent, mut returned, mut arriving) = (0.0f64, Rgb::ZERO, Rgb::ZERO, Rgb::ZERO);
    for (i, &b) in first.iter().enumerate() {
        let a = area(i) * survey.lit[i];
        total += a as f64;
        sent += b * a;
        returned += elements.reflectance[i] * a;
        arriving += (elements.direct[i] + survey.sky[i]) * area(i);
    }
    let total = (total as f32).max(f32::MIN_POSITIVE);
    let ambient = sent / total / (Rgb::ONE - returned / total).max(Rgb::splat(0.05));
    let all: f32 = tree.nodes.first().map_or(1.0, |n| n.area).max(f32::MIN_POSITIVE);
    let mean = (arriving / all + ambient * (total / all)).element_sum() / 3.0;
    let guess = first.iter().zip(&elements.reflectance).map(|(&b, &r)| b + r * ambient).collect();
    (link_error * mean.max(f32::MIN_POSITIVE), guess)
}

/// Deviation of the radiosity of elements inside each node, W/m².
fn variation(tree: &Hierarchy, elements: &[Rgb], mean: &[Rgb]) -> Vec<f32> {
    let squares: Vec<Rgb> = elements.iter().map(|&b| b * b).collect();
    pull(tree, &squares).iter().zip(mean).map(|(&s, &m)| (s - m * m).max_element().max(0.0).sqrt()).collect()
}

/// Jacobi iteration of B = B₀ + ρ·E(B). Returns E per element and the number of iterations.
fn iterate(
    tree: &Hierarchy,
    links: &Links,
    closure: &Closure,
    elements: &Elements,
    first: &[Rgb],
    settings: &SolveSettings,
    progress: &dyn Progress,
) -> Result<(Vec<Rgb>, u32), Cancelled> {
    let mut irradiance = vec![Rgb::ZERO; first.len()];
    let mut total = 0.0f64;
    for iteration in 1..=settings.iterations {
        let sent: Vec<Rgb> = (0..first.len())
            .into_par_iter()
            .map(|i| (first[i] + elements.reflectance[i] * irradiance[i]) * closure.sending[i])
            .collect();
        irradiance = transfer(tree, links, &sent);
        irradiance.par_iter_mut().zip(&closure.receiving).for_each(|(e, &s)| *e *= s);
        let area = |i: usize| tree.nodes[tree.elements[i].node as usize].area as f64;
        let now: f64 = irradiance.iter().enumerate().map(|(i, e)| e.element_sum() as f64 * area(i)).sum();
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
        progress.report(Stage::Solve, 0.9 + 0.1 * iteration as f64 / settings.iterations as f64);
        if (now - total).abs() <= settings.convergence as f64 * now {
            return Ok((irradiance, iteration));
        }
        total = now;
    }
    Ok((irradiance, settings.iterations))
}
