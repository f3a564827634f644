//! Photos: JPEG, PNG, WebP, GIF, EXR.
#![no_main]

fuzz::door!(photo);
