//! A field as a proxy for a cloud: where nothing is known of the surfaces, a fast field is trained first, and Gaussians begin where it
//! sees them.
//!
//! ```text
//! steps of the field -> seeds: random pixels of all photos, at its median depth -> steps of the cloud
//!                       refill: pixels of the step's photo, drawn by their error, at its median depth
//! ```
//!
//! A cloud that begins at random places spends its first thousands of steps on finding surfaces, and keeps floaters that it never
//! loses. A field finds them in seconds; a cloud shows them sharper.
//!
//! Baranowski, Esposito, Gschoßmann, Chen, Geiger, "ConeGS: error-guided densification using pixel cones for improved reconstruction
//! with fewer primitives", 2025. What differs, and what was measured: `docs/decisions/0042-a-field-before-a-cloud-without-points.md`.

mod seen;
mod system;

pub(crate) use system::{FieldConfig, Proxied, ProxyTerms};
