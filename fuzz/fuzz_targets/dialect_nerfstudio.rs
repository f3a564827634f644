//! `transforms.json` of nerfstudio, and its points.
#![no_main]

fuzz::door!(dialect_nerfstudio);
