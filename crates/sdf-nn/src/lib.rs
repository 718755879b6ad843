//! sdf-nn
