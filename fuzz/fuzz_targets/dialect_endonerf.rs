//! An endoscope: `poses_bounds.npy`, masks, depth.
#![no_main]

fuzz::door!(dialect_endonerf);
