//! Files of a run folder that are read again.
#![no_main]

fuzz::door!(run_files);
