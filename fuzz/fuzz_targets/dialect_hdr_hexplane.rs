//! The Blender form with frame numbers and exposures.
#![no_main]

fuzz::door!(dialect_hdr_hexplane);
