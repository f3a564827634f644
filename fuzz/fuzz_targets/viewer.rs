//! Messages of the viewer's page.
#![no_main]

fuzz::door!(viewer);
