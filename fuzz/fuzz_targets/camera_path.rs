//! Files of cameras to render along, both forms.
#![no_main]

fuzz::door!(camera_path);
