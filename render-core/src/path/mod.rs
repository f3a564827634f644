//! Camera paths for rendering.
//!
//! * [`Arc`]: the part of an orbit that a set of cameras covers, with their radius, height and view at each azimuth.
//! * [`Orbit`]: a whole circle around what they look at; [`Spiral`]: for cameras that face one way.
//! * [`Rail`]: a smooth curve along given poses at constant speed; [`through`]: the spline it is made of.
//! * [`order`]: which cameras a path visits, and in which order.

mod arc;
mod circle;
pub mod order;
mod rail;
mod spiral;
mod through;

pub use self::{
    arc::Arc,
    circle::Orbit,
    rail::Rail,
    spiral::Spiral,
    through::{Ends, through},
};
