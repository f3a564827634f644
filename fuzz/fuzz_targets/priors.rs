//! Segments, features, flow beside photos.
#![no_main]

fuzz::door!(priors);
