//! Initialisers by name.
//!
//! ```
//! use field_core::init::Init;
//! use field_core::rng::Rng;
//!
//! let init: Init = "he_uniform".parse().unwrap();
//! let mut weights = [0.0; 64 * 32];
//! init.fill(Rng::new(1, 0), 32, 64, &mut weights);
//! assert!(weights.iter().all(|w| w.abs() <= (6.0_f32 / 32.0).sqrt()));
//!
//! assert_eq!("uniform:0.0001".parse(), Ok(Init::Uniform(1e-4)));
//! assert_eq!("kaimming".parse::<Init>().unwrap_err().to_string(), "unknown initialiser `kaimming`; one of: \
//!     uniform[:BOUND], normal[:DEVIATION], constant:VALUE, zeros, xavier_uniform (glorot), xavier_normal, \
//!     he_uniform (kaiming), he_normal");
//! ```

use alloc::string::{String, ToString};
use core::fmt;
use core::str::FromStr;

use float_core::m32;

use crate::rng::Rng;

/// Distribution of the initial parameters. `fan_in` and `fan_out` are the inputs and outputs of the layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Init {
    /// Uniform in `[-bound, bound)`. The hash grid starts with `1e-4`, the bound of the plain name `uniform`.
    Uniform(f32),
    /// Normal with this deviation around 0. The plain name `normal` has 1.
    Normal(f32),
    /// All this value.
    Constant(f32),
    /// All 0.
    Zeros,
    /// Uniform with bound `sqrt(6 / (fan_in + fan_out))`. Glorot and Bengio, 2010, eq. 16.
    XavierUniform,
    /// Normal with variance `2 / (fan_in + fan_out)`.
    XavierNormal,
    /// Uniform with bound `sqrt(6 / fan_in)`. He et al., 2015, eq. 10: keeps the variance through ReLU.
    HeUniform,
    /// Normal with variance `2 / fan_in`.
    HeNormal,
}

/// The names [`Init`] is parsed from.
const NAMES: &str = "uniform[:BOUND], normal[:DEVIATION], constant:VALUE, zeros, xavier_uniform (glorot), xavier_normal, \
    he_uniform (kaiming), he_normal";

impl Init {
    /// Fill `out` with draws `0..out.len()` of `rng`. A fan of 0 counts as 1.
    pub fn fill(self, rng: Rng, fan_in: usize, fan_out: usize, out: &mut [f32]) {
        let fan_in = fan_in.max(1) as f32;
        let both = fan_in + fan_out as f32;
        match self {
            Self::Uniform(bound) => uniform(rng, bound, out),
            Self::Normal(deviation) => normal(rng, deviation, out),
            Self::Constant(value) => out.fill(value),
            Self::Zeros => out.fill(0.0),
            Self::XavierUniform => uniform(rng, m32::sqrt(6.0 / both), out),
            Self::XavierNormal => normal(rng, m32::sqrt(2.0 / both), out),
            Self::HeUniform => uniform(rng, m32::sqrt(6.0 / fan_in), out),
            Self::HeNormal => normal(rng, m32::sqrt(2.0 / fan_in), out),
        }
    }
}

fn uniform(rng: Rng, bound: f32, out: &mut [f32]) {
    rng.fill_uniform(0, out);
    for x in out {
        *x = (2.0 * *x - 1.0) * bound;
    }
}

fn normal(rng: Rng, deviation: f32, out: &mut [f32]) {
    rng.fill_normal(0, out);
    for x in out {
        *x *= deviation;
    }
}

/// Why a text is not the name of an initialiser.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InitError {
    /// No such name.
    Unknown(String),
    /// A number after a colon is missing, wrong, or not allowed for this name.
    Argument(String),
}

impl fmt::Display for InitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(text) => write!(f, "unknown initialiser `{text}`; one of: {NAMES}"),
            Self::Argument(text) => write!(f, "initialiser `{text}` has a wrong or missing number; one of: {NAMES}"),
        }
    }
}

impl core::error::Error for InitError {}

impl FromStr for Init {
    type Err = InitError;

    fn from_str(text: &str) -> Result<Self, InitError> {
        let (name, number) = match text.split_once(':') {
            Some((name, number)) => (name, Some(number)),
            None => (text, None),
        };
        let wrong = || InitError::Argument(text.to_string());
        let value = number.map(|n| n.parse().ok().filter(|x: &f32| x.is_finite()).ok_or_else(wrong)).transpose()?;
        let spread = value.filter(|x| *x >= 0.0);
        let init = match name {
            "uniform" if value == spread => return Ok(Self::Uniform(spread.unwrap_or(1e-4))),
            "normal" if value == spread => return Ok(Self::Normal(spread.unwrap_or(1.0))),
            "uniform" | "normal" => return Err(wrong()),
            "constant" => return value.map(Self::Constant).ok_or_else(wrong),
            "zeros" => Self::Zeros,
            "xavier_uniform" | "glorot" | "glorot_uniform" => Self::XavierUniform,
            "xavier_normal" | "glorot_normal" => Self::XavierNormal,
            "he_uniform" | "kaiming" | "kaiming_uniform" => Self::HeUniform,
            "he_normal" | "kaiming_normal" => Self::HeNormal,
            _ => return Err(InitError::Unknown(text.to_string())),
        };
        if value.is_some() { Err(wrong()) } else { Ok(init) }
    }
}

impl fmt::Display for Init {
    /// A text that parses to the same initialiser.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uniform(bound) => write!(f, "uniform:{bound}"),
            Self::Normal(deviation) => write!(f, "normal:{deviation}"),
            Self::Constant(value) => write!(f, "constant:{value}"),
            Self::Zeros => f.write_str("zeros"),
            Self::XavierUniform => f.write_str("xavier_uniform"),
            Self::XavierNormal => f.write_str("xavier_normal"),
            Self::HeUniform => f.write_str("he_uniform"),
            Self::HeNormal => f.write_str("he_normal"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Init; 8] = [
        Init::Uniform(0.25),
        Init::Normal(0.5),
        Init::Constant(-2.0),
        Init::Zeros,
        Init::XavierUniform,
        Init::XavierNormal,
        Init::HeUniform,
        Init::HeNormal,
    ];

    #[test]
    fn names_round_trip() {
        for init in ALL {
            assert_eq!(init.to_string().parse(), Ok(init));
        }
        for (name, init) in [
            ("glorot", Init::XavierUniform),
            ("kaiming", Init::HeUniform),
            ("uniform", Init::Uniform(1e-4)),
            ("normal", Init::Normal(1.0)),
        ] {
            assert_eq!(name.parse(), Ok(init));
        }
    }

    #[test]
    fn wrong_texts_are_refused_with_the_names() {
        for text in
            ["", "xavier", "constant", "constant:", "uniform:-1", "normal:nan", "zeros:1", "he_normal:2", "uniform:inf"]
        {
            let message = text.parse::<Init>().unwrap_err().to_string();
            assert!(message.contains(text) && message.contains("he_normal") && message.contains("glorot"), "{message}");
        }
    }

    #[test]
    fn moments_are_those_of_the_names() {
        const N: usize = 40_000;
        let (fan_in, fan_out) = (48, 80);
        for (init, variance) in
            ALL.into_iter().zip([0.25 * 0.25 / 3.0, 0.25, 0.0, 0.0, 2.0 / 128.0, 2.0 / 128.0, 2.0 / 48.0, 2.0 / 48.0])
        {
            let mut w = alloc::vec![9.0; N];
            init.fill(Rng::new(3, 1), fan_in, fan_out, &mut w);
            let mean = w.iter().map(|&w| f64::from(w)).sum::<f64>() / N as f64;
            let spread = w.iter().map(|&w| (f64::from(w) - mean).powi(2)).sum::<f64>() / N as f64;
            let center = if init == Init::Constant(-2.0) { -2.0 } else { 0.0 };
            // Five standard errors; the variance's is at most sqrt(2 / n) of itself.
            assert!((mean - center).abs() <= 5.0 * f64::sqrt(variance / N as f64), "{init}: mean {mean}");
            assert!((spread - variance).abs() <= 0.036 * variance, "{init}: variance {spread}");
        }
    }

    #[test]
    fn nothing_to_fill_and_no_fan_are_legal() {
        for init in ALL {
            init.fill(Rng::new(0, 0), 0, 0, &mut []);
            let mut one = [f32::NAN];
            init.fill(Rng::new(0, 0), 0, 0, &mut one);
            assert!(one[0].is_finite());
        }
    }
}
