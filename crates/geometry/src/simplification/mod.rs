//! simplification
