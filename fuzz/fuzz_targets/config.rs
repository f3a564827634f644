//! `config.toml`, and words of the command line.
#![no_main]

fuzz::door!(config);
