//! `transforms.json` of instant-ngp, and lists of splits.
#![no_main]

fuzz::door!(dialect_instant_ngp);
