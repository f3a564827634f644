//! NeRF's and D-NeRF's form.
#![no_main]

fuzz::door!(dialect_blender);
