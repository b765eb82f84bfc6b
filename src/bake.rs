//! stage order
