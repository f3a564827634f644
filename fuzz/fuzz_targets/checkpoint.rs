//! Checkpoints whose checksums hold: JSON file, arrays, the run opened and a step trained.
#![no_main]

fuzz::door!(checkpoint);
