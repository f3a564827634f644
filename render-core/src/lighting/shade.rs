//! Irradiance to colour, and density gradients to normals.

use crate::real::{Real, dot};

/// From linear irradiance to the scale of albedo and photograph, which are display-referred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Tone {
    /// `max(E, 1e-4)^(1 / 2.2)`.
    #[default]
    Gamma,
    /// `E` as it is.
    Identity,
}

/// Irradiance below this counts as this before the power of [`Tone::Gamma`], whose derivative at 0 is infinite. Darkness becomes
/// 0.015 of the albedo: below four steps of 255.
pub const MIN_IRRADIANCE: f64 = 1e-4;

const GAMMA: f64 = 1.0 / 2.2;

impl Tone {
    /// The value and its derivative; below [`MIN_IRRADIANCE`] the derivative of [`Tone::Gamma`] is 0.
    #[inline]
    #[must_use]
    pub fn apply<T: Real>(self, e: T) -> (T, T) {
        match self {
            Self::Identity => (e, T::ONE),
            Self::Gamma => {
                let least = T::of(MIN_IRRADIANCE);
                let inside = e.max(least);
                let value = inside.powf(T::of(GAMMA));
                // A comparison that NaN fails, as it should.
                (value, if e > least { T::of(GAMMA) * value / inside } else { T::ZERO })
            }
        }
    }
}

/// Colour of a surface: `shadow * albedo * tone(irradiance)`, channel by channel.
#[inline]
#[must_use]
pub fn shade<T: Real>(tone: Tone, albedo: [T; 3], shadow: T, irradiance: [T; 3]) -> [T; 3] {
    core::array::from_fn(|c| shadow * albedo[c] * tone.apply(irradiance[c]).0)
}

/// Gradient of [`shade`]: adds.
#[inline]
#[expect(clippy::too_many_arguments, reason = "three inputs, the gradient that comes and those that go")]
pub fn shade_backward<T: Real>(
    tone: Tone,
    albedo: [T; 3],
    shadow: T,
    irradiance: [T; 3],
    out_bar: [T; 3],
    albedo_bar: &mut [T; 3],
    shadow_bar: &mut T,
    irradiance_bar: &mut [T; 3],
) {
    for c in 0..3 {
        let (value, derivative) = tone.apply(irradiance[c]);
        albedo_bar[c] += shadow * value * out_bar[c];
        *shadow_bar += albedo[c] * value * out_bar[c];
        irradiance_bar[c] += shadow * albedo[c] * derivative * out_bar[c];
    }
}

/// The sun as one surface sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun<T = f32> {
    /// Irradiance on a surface that faces it, linear colour.
    pub irradiance: [T; 3],
    /// 0 in its shadow, 1 outside; between where shadows are soft.
    pub visibility: T,
    /// Cosine between the surface's unit normal and the unit direction to the sun.
    pub cosine: T,
}

/// Gradient with respect to a [`Sun`]; added to.
pub type SunBar<T = f32> = Sun<T>;

/// Linear colour of a matt surface under a sky and a sun: `albedo / pi * (max(ambient, 0) + visibility * sun * max(cosine, 0))`,
/// with irradiance `ambient` from the sky.
///
/// # Source
/// Rudnev et al., 2022, section 4.5, which leaves out the albedo.
#[inline]
#[must_use]
pub fn sun_and_sky<T: Real>(albedo: [T; 3], ambient: [T; 3], sun: Sun<T>) -> [T; 3] {
    let direct = sun.visibility * sun.cosine.max(T::ZERO);
    core::array::from_fn(|c| albedo[c] * inv_pi::<T>() * (ambient[c].max(T::ZERO) + sun.irradiance[c] * direct))
}

/// Gradient of [`sun_and_sky`]: adds. 0 where the ambient light or the cosine is not positive.
#[inline]
pub fn sun_and_sky_backward<T: Real>(
    albedo: [T; 3],
    ambient: [T; 3],
    sun: Sun<T>,
    out_bar: [T; 3],
    albedo_bar: &mut [T; 3],
    ambient_bar: &mut [T; 3],
    sun_bar: &mut SunBar<T>,
) {
    let facing = sun.cosine.max(T::ZERO);
    for c in 0..3 {
        let through = albedo[c] * inv_pi::<T>() * out_bar[c];
        let light = ambient[c].max(T::ZERO) + sun.irradiance[c] * sun.visibility * facing;
        albedo_bar[c] += inv_pi::<T>() * light * out_bar[c];
        if ambient[c] > T::ZERO {
            ambient_bar[c] += through;
        }
        sun_bar.irradiance[c] += through * sun.visibility * facing;
        sun_bar.visibility += through * sun.irradiance[c] * facing;
        if sun.cosine > T::ZERO {
            sun_bar.cosine += through * sun.irradiance[c] * sun.visibility;
        }
    }
}

#[inline(always)]
fn inv_pi<T: Real>() -> T {
    T::of(core::f64::consts::FRAC_1_PI)
}

/// Length below which a density gradient counts as this long.
const MIN_LENGTH: f64 = 1e-8;

/// The unit normal that points out of matter: `-g / max(|g|, 1e-8)` of the (weighted) density gradient `g`, which points into
/// it. A zero gradient has a zero normal.
#[inline]
#[must_use]
pub fn outward_normal<T: Real>(gradient: [T; 3]) -> [T; 3] {
    let inverse = T::ONE / length(gradient).max(T::of(MIN_LENGTH));
    gradient.map(|g| -g * inverse)
}

/// Gradient of [`outward_normal`]: adds. Nothing where the density gradient is zero.
#[inline]
pub fn outward_normal_backward<T: Real>(gradient: [T; 3], n_bar: [T; 3], gradient_bar: &mut [T; 3]) {
    let (long, least) = (length(gradient), T::of(MIN_LENGTH));
    if long == T::ZERO {
        return;
    }
    let inverse = T::ONE / long.max(least);
    let n = gradient.map(|g| -g * inverse);
    // Along the normal only the length changes, which the division takes out again; below the least length it does not.
    let along = if long > least { dot(n, n_bar) } else { T::ZERO };
    for c in 0..3 {
        gradient_bar[c] += -inverse * (n_bar[c] - along * n[c]);
    }
}

/// Euclidean length; the largest coordinate is taken out first, for squares of 1e20 are beyond `f32`.
#[inline(always)]
fn length<T: Real>(x: [T; 3]) -> T {
    let s = x[0].abs().max(x[1].abs()).max(x[2].abs());
    if s == T::ZERO {
        return T::ZERO;
    }
    let u = x.map(|x| x / s);
    s * dot(u, u).sqrt()
}
