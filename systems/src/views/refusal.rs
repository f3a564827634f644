//! What is said where rasteriser, losses or density control refuse something.

use super::pass::PassError;
use engine::system::SystemError;
use splat_core::SplatError;

/// That there is more than can be counted, which fewer Gaussians help; or numbers that no picture can be made of.
pub(crate) fn refused(e: impl Into<PassError>) -> SystemError {
    let e = e.into();
    match &e {
        PassError::Splat(SplatError::TooMany { .. }) => {
            SystemError::Config { field: "max_splats", value: e.to_string(), problem: "allow fewer Gaussians".into() }
        }
        _ => SystemError::Picture {
            problem: format!("{e}: look at the cameras, and at `radius` and `centre` where they were set"),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use losses::LossError;

    #[test]
    fn only_what_cannot_be_counted_asks_for_fewer_gaussians() {
        let said = |e: PassError| refused(e).to_string();
        assert_eq!(
            said(SplatError::TooMany { what: "Gaussians", got: 5_000_000_000 }.into()),
            "`max_splats` = 5000000000 Gaussians: at most 4294967295 are possible: allow fewer Gaussians"
        );
        assert_eq!(
            said(SplatError::Value { what: "view", got: f64::NEG_INFINITY, accepts: "finite numbers" }.into()),
            "no picture can be made of the Gaussians: `view` is -inf, expected finite numbers: look at the cameras, and at `radius` and \
             `centre` where they were set"
        );
        let of_loss = said(LossError::Shape { what: "x", want: 3, got: 2 }.into());
        assert!(of_loss.starts_with("no picture can be made") && !of_loss.contains("max_splats"), "{of_loss}");
    }
}
