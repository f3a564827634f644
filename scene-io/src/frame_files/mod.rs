//! What stands beside a frame's photo, decoded at its own size and checked: `Frame::read_*`.

mod depth;
mod features;
mod flow;
mod masks;
mod motion;
mod segments;

pub use masks::refuse_blank_masks;
