//! The tests of this crate in one program: built and linked once. `cargo test -p wildfield-render-core --test all MODULE::` runs one file of them.

mod bilateral;
mod budget;
mod cameras;
mod compositor;
mod frustum;
mod histogram;
mod importance;
mod induced_flow;
mod lighting;
mod occupancy;
mod occupancy_cells;
mod proposal;
mod quadrature;
mod quadrature_blend;
mod quadrature_physics;
mod quadrature_rules;
mod quadrature_two;
mod ray_gradients;
mod rays;
mod sample;
mod sample_linear;
mod space;
