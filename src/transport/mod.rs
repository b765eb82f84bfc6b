//! Energy exchange between surfaces: form factors, links and their refinement.

mod exchange;
pub mod form_factor;
mod links;
mod oracle;
mod refine;
pub mod soft_box;

pub use exchange::{Exchange, SELF_INTERSECTION};
pub use links::{Link, Links};
pub use oracle::{Decision, ErrorOracle, Estimate, Oracle};
pub use refine::{RefineSettings, refine};
