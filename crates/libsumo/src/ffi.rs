//! Bindings of `shim/shim.h`, made by bindgen: `UPDATE_BINDINGS=1 cargo test -p libsumo`.

#![allow(dead_code, non_camel_case_types, unreachable_pub, clippy::all, reason = "bindgen writes it")]

pub const DS_LANE: ds_kind = 0;
pub const DS_LIGHT: ds_kind = 1;
pub const DS_ROUTE: ds_kind = 2;
pub const DS_TYPE: ds_kind = 3;
pub type ds_kind = std::ffi::c_uint;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_cars {
    pub starts: *const u32,
    pub cars: *const u64,
    pub positions: *const f64,
    pub speeds: *const f64,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_states {
    pub starts: *const u32,
    pub letters: *const std::ffi::c_char,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_insertion {
    pub car: u64,
    pub position: f64,
    pub speed: f64,
    pub route: u32,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_entering {
    pub car: u64,
    pub position: f64,
    pub speed: f64,
    pub speed_factor: f64,
    pub end: f64,
    pub route: u32,
    pub type_: u32,
    pub lane: u32,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_placing {
    pub car: u64,
    pub position: f64,
    pub speed: f64,
    pub lane: u32,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_departures {
    pub count: usize,
    pub starts: *const u32,
    pub letters: *const std::ffi::c_char,
    pub cars: *const u64,
    pub lanes: *const u32,
    pub positions: *const f64,
    pub speeds: *const f64,
    pub speed_factors: *const f64,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_route {
    pub edges: *const std::ffi::c_char,
    pub at: u32,
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_counts {
    pub departed: u32,
    pub arrived: u32,
    pub pending: u32,
    pub teleports: u32,
    pub collisions: u32,
    pub emergency_stops: u32,
}
unsafe extern "C" {
    pub fn ds_last_error() -> *const std::ffi::c_char;
    pub fn ds_open(library: *const std::ffi::c_char) -> std::ffi::c_int;
    pub fn ds_version(text: *mut *const std::ffi::c_char) -> std::ffi::c_int;
    pub fn ds_c_library(version: *mut *const std::ffi::c_char) -> std::ffi::c_int;
    pub fn ds_load(options: *const *const std::ffi::c_char, count: usize) -> std::ffi::c_int;
    pub fn ds_close() -> std::ffi::c_int;
    pub fn ds_register(
        kind: ds_kind,
        names: *const *const std::ffi::c_char,
        count: usize,
        first: *mut u32,
    ) -> std::ffi::c_int;
    pub fn ds_step() -> std::ffi::c_int;
    pub fn ds_time(seconds: *mut f64) -> std::ffi::c_int;
    pub fn ds_read_lanes(lanes: *const u32, count: usize, cars: *mut ds_cars) -> std::ffi::c_int;
    pub fn ds_read_lights(lights: *const u32, count: usize, states: *mut ds_states) -> std::ffi::c_int;
    pub fn ds_set_lights(lights: *const u32, count: usize, states: *const ds_states) -> std::ffi::c_int;
    pub fn ds_set_programs(lights: *const u32, count: usize, program: *const std::ffi::c_char) -> std::ffi::c_int;
    pub fn ds_insert(cars: *const ds_insertion, count: usize) -> std::ffi::c_int;
    pub fn ds_enter(cars: *const ds_entering, count: usize) -> std::ffi::c_int;
    pub fn ds_place(cars: *const ds_placing, count: usize) -> std::ffi::c_int;
    pub fn ds_seed_generators(first: u32, seeds: *const u32, count: usize) -> std::ffi::c_int;
    pub fn ds_clear_pending() -> std::ffi::c_int;
    pub fn ds_remove_cars(lanes: *const u32, count: usize) -> std::ffi::c_int;
    pub fn ds_read_departures(departures: *mut ds_departures) -> std::ffi::c_int;
    pub fn ds_read_departed(count: *mut usize, cars: *mut *const u64) -> std::ffi::c_int;
    pub fn ds_read_gone(count: *mut usize, cars: *mut *const u64) -> std::ffi::c_int;
    pub fn ds_read_route(car: *const std::ffi::c_char, route: *mut ds_route) -> std::ffi::c_int;
    pub fn ds_counts(counts: *mut ds_counts) -> std::ffi::c_int;
}
