//! Energy exchange between surfaces: form factors, links and their refinement.

mod exchange;
pub mod form_factor;
mod links;
mod oracle;
mod projected_polygon;
mod refine;
pub mod soft_box;

pub use exchange::{Exchange, SELF_INTERSECTION};
pub use links::{Link, Links};
pub use oracle::{Decision, ErrorOracle, Estimate, Oracle};
pub use projected_polygon::ProjectedPolygon;
pub use refine::{RefineSettings, refine};
