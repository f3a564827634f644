//! Whole systems: trained, resumed, compared.

mod d_nerf_published;
mod dynamic;
mod dynamic_appearance;
mod e2e_static;
mod every_system;
mod left_out;
mod mip_nerf;
mod mip_nerf_360;
mod nerf_method;
mod nerf_published;
mod sf_nerf;
mod splat_field;
mod splat_pictures;
mod splat_start;
mod splat_stop;
mod splat_threads;
mod splat_training;
mod spotless;
mod wild_auto;
mod wild_clouds;
mod wild_ha_nerf;
mod wild_maps;
mod wild_methods;
mod wild_mlp;
mod wild_planes;
mod wild_sky;
