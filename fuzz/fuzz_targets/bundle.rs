//! Any bytes as bundles and their images.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh_fuzz::read_as;
use steadymesh_mesh_io::Format;

fuzz_target!(|bytes: &[u8]| read_as(Format::Bundle, bytes));
