//! Every system, a line each.

use super::{Build, Entry, Family, Needs};
use crate::claims::Claim;
use crate::papers::dynamic::{
    d_nerf, d_nerf_published, dynamic_nerf, endo_nerf, hyper_nerf, k_planes, nerfies, nsff, t_nerf, tineuvox, two_parts,
};
use crate::papers::gaussians::{degauss, four_d_gaussians, gs_w, splat, spotless, wild_gaussians, wild_gs};
use crate::papers::static_scenes::{mip_nerf, mip_nerf_360, nerf, ngp};
use crate::papers::wild::{
    AppearanceKind as A, OccluderKind as O, auto, build as parts, combined, ha_nerf, hugs, nerf_w, robust_nerf, sf_nerf,
};

/// For scenes that stand still, from any photos.
const fn still(claim: Claim, build: Build) -> Entry {
    Entry { claim, on_networks: None, families: &[Family::Static], needs: Needs::Photos, build }
}

/// For any photos: of a scene that stands still, or that moves where they show several times.
const fn any(claim: Claim, build: Build) -> Entry {
    Entry { families: &[Family::Static, Family::Moving], ..still(claim, build) }
}

/// For photos with occluders or of different appearance.
const fn wild(claim: Claim, build: Build) -> Entry {
    Entry { families: &[Family::Wild], ..still(claim, build) }
}

/// For scenes that move, from photos of several times.
const fn moving(claim: Claim, build: Build) -> Entry {
    Entry { claim, on_networks: None, families: &[Family::Moving], needs: Needs::Times, build }
}

/// All systems, each family in the order in which it is listed.
pub(super) const ENTRIES: &[Entry] = &[
    any(ngp::CLAIM, ngp::build),
    still(nerf::CLAIM, nerf::build),
    still(mip_nerf::CLAIM, mip_nerf::build),
    still(mip_nerf_360::CLAIM, mip_nerf_360::build),
    still(splat::CLAIM, splat::build),
    wild(auto::CLAIM, |ask| parts(ask, None)),
    wild(combined::PLAIN, |ask| parts(ask, Some((A::None, O::None)))),
    wild(robust_nerf::CLAIM, |ask| parts(ask, Some((A::None, O::Robust)))),
    wild(nerf_w::NERF_A, |ask| parts(ask, Some((A::Codes, O::None)))),
    wild(nerf_w::NERF_U, |ask| parts(ask, Some((A::None, O::Transient)))),
    wild(nerf_w::NERF_W, |ask| parts(ask, Some((A::Codes, O::Transient)))),
    wild(ha_nerf::HA_NERF_A, |ask| parts(ask, Some((A::Encoder, O::None)))),
    wild(ha_nerf::HA_NERF_T, |ask| parts(ask, Some((A::None, O::Visibility)))),
    wild(ha_nerf::HA_NERF, |ask| parts(ask, Some((A::Encoder, O::Visibility)))),
    wild(sf_nerf::CLAIM, |ask| parts(ask, Some((A::Codes, O::Filter)))),
    wild(hugs::CLAIM, |ask| parts(ask, Some((A::None, O::Masks)))),
    wild(wild_gaussians::CLAIM, wild_gaussians::build),
    wild(gs_w::CLAIM, gs_w::build),
    wild(wild_gs::CLAIM, wild_gs::build),
    wild(spotless::CLAIM, spotless::build),
    Entry { families: &[Family::Wild, Family::Moving], ..wild(degauss::CLAIM, degauss::build) },
    moving(two_parts::CLAIM, two_parts::build),
    moving(t_nerf::CLAIM, t_nerf::build),
    Entry { on_networks: Some(d_nerf_published::CLAIM), ..moving(d_nerf::CLAIM, d_nerf::build) },
    moving(nerfies::CLAIM, nerfies::build),
    moving(hyper_nerf::CLAIM, hyper_nerf::build),
    moving(tineuvox::CLAIM, tineuvox::build),
    any(k_planes::CLAIM, k_planes::build),
    moving(endo_nerf::CLAIM, endo_nerf::build),
    moving(nsff::CLAIM, nsff::build),
    moving(dynamic_nerf::CLAIM, dynamic_nerf::build),
    moving(four_d_gaussians::CLAIM, four_d_gaussians::build),
];
