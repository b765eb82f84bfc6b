//! What the lighting stages tell whoever follows them: what they have found, how the lightmap looks by now, and what an
//! interrupted bake had found before.

use super::effort::Effort;
use crate::gather::{Bounce, Direct, Lightmap, Probe};
use crate::output::State;
use crate::output::report::SolverFacts;
use crate::progress::Cancelled;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// How rays of refinements are counted.
pub(super) const REFINE: &str = "refine";

/// What the lighting stages did.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Counts {
    /// Sizes of the radiosity system and of the gather.
    pub solver: SolverFacts,
    /// Rays by purpose.
    pub rays: BTreeMap<String, u64>,
}

/// The radiosity solution as far as the gather needs it.
#[derive(Serialize, Deserialize)]
pub struct Solution {
    /// Surfaces whose backs are part of the hierarchy.
    pub backs: Vec<bool>,
    /// Irradiance of all receivers.
    pub bounce: Bounce,
    /// What is asked of probes.
    pub effort: Effort,
    /// What it took.
    pub counts: Counts,
}

/// What would be costly to find again.
#[derive(Default, Serialize, Deserialize)]
pub struct Found {
    /// Light straight from lamps.
    pub direct: Option<Direct>,
    /// The radiosity solution.
    pub solution: Option<Solution>,
    /// Texels with their probes.
    pub probes: Vec<(u32, Probe)>,
}

/// The same, while it is in use.
#[derive(Clone, Copy, Serialize)]
pub struct FoundSoFar<'a> {
    /// Light straight from lamps.
    pub direct: Option<&'a Direct>,
    /// The radiosity solution.
    pub solution: Option<&'a Solution>,
    /// Texels with their probes.
    pub probes: &'a [(u32, Probe)],
}

/// A lightmap on its way.
pub struct Draft {
    /// Irradiance of every texel.
    pub lightmap: Lightmap,
    /// What it is, and the error to expect of it.
    pub state: State,
}

impl From<(Lightmap, State)> for Draft {
    fn from((lightmap, state): (Lightmap, State)) -> Self {
        Self { lightmap, state }
    }
}

/// Texels to gather again, and the relative error to aim for there.
pub struct Refinement {
    /// Runs of texels.
    pub tiles: Vec<Range<u32>>,
    /// As a share of the mean irradiance.
    pub error: f32,
}

/// Follows the lighting stages.
pub trait Observer {
    /// What an interrupted bake of the same scene with the same settings had found. Asked once.
    fn found_before(&mut self) -> Found {
        Found::default()
    }

    /// True if drafts are wanted.
    fn wants_drafts(&self) -> bool {
        false
    }

    /// More was found. `draft` shows the lightmap as it is now, which takes some time; none where there is nothing to show.
    fn found(&mut self, _so_far: &FoundSoFar, _counts: &Counts, _draft: &mut dyn FnMut() -> Option<Draft>) {}

    /// What is to be gathered again of a finished lightmap, if anything. `probes` are those of the gather that all texels
    /// had, and tell what each took.
    fn judge(&mut self, _: &Lightmap, _probes: &[(u32, Probe)], _: &Counts) -> Result<Option<Refinement>, Cancelled> {
        Ok(None)
    }
}

/// Does not look.
impl Observer for () {}
