//! Depth maps and masks: `.npy`, PNG, EXR.
#![no_main]

fuzz::door!(maps);
