//! Bindings that bindgen makes from `shim/dials_sumo.h`.

#![allow(dead_code, non_camel_case_types, clippy::all, reason = "bindgen writes it")]

include!(concat!(env!("OUT_DIR"), "/dials_sumo.rs"));
