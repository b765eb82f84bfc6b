//! Final gather: irradiance per texel from lamps (sent, with shared visibility) and from everything else (probed).

mod alike;
mod bounce;
mod cells;
mod choice;
mod direct;
mod emitter_triangle;
mod emitters;
mod footprint;
mod guide;
mod inside;
mod lamp;
mod lit_scene;
mod look;
mod near;
mod obstacles;
mod openings;
mod parts;
mod portal;
mod probe;
mod region;
mod secondary;
mod sending;
mod shared;
mod smooth;
mod source;
mod tally;
mod visibility;

pub use bounce::{Bounce, NOTHING, bounce};
pub use cells::{CellSettings, Gathering, Indirect, Start as GatherStart, Tiles, indirect};
pub use direct::{Direct, DirectSettings, closer_direct, element_direct, element_sky, texel_direct};
pub use emitters::{Emission, classify};
pub use footprint::Footprint;
pub use guide::Guide;
pub use lamp::Lamp;
pub use lit_scene::{LitScene, shut_texels};
pub use openings::Portals;
pub use probe::{FewestRays, Probe, ProbeSettings};
pub use smooth::{Smooth, smooth};
pub use source::Source;
pub use tally::Grouped;
pub use visibility::Lamps;

use crate::scene::Rgb;

/// Irradiance of every texel, W/m², split by how the light came.
#[derive(Clone, Debug, Default)]
pub struct Lightmap {
    /// Straight from lamps and from emitters that are treated as lamps.
    pub direct: Vec<Rgb>,
    /// Everything: lamps, sky, emissive surfaces and all bounces.
    pub combined: Vec<Rgb>,
    /// The same by light group.
    pub groups: Grouped,
    /// What of it came straight from lamps, by light group.
    pub direct_groups: Grouped,
    /// False where a texel lies inside other geometry and is to be filled from its neighbours.
    pub usable: Vec<bool>,
}
