//! The tests of this crate in one program: built and linked once. `cargo test -p wildfield-field-core --test all MODULE::` runs one file of them.
//! Those that count allocations have programs of their own.

mod conv;
mod conv_encoder;
mod conv_twin;
mod deform;
mod encodings;
mod hash_grid;
mod integrated;
mod k_planes;
mod lie;
mod mlp;
mod mlp_bf16;
mod mlp_twin;
mod multi_distance;
mod network;
mod planes;
mod tape_api;
mod tape_graphs;
mod tape_ops;
mod tape_pairs;
mod tape_second_order;
mod tape_twin;
