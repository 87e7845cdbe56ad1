//! Bindings of `shim/shim.h`, made by bindgen: `UPDATE_BINDINGS=1 cargo test -p libsumo`.

#![allow(dead_code, non_camel_case_types, unreachable_pub, clippy::all, reason = "bindgen writes it")]

pub const DS_DEVICES: ds_shortcut = 1;
pub const DS_GENERATORS: ds_shortcut = 2;
pub const DS_LANES: ds_shortcut = 4;
pub const DS_TEXTS: ds_shortcut = 8;
pub type ds_shortcut = std::ffi::c_uint;
pub const DS_LANE: ds_kind = 0;
pub const DS_LIGHT: ds_kind = 1;
pub const DS_ROUTE: ds_kind = 2;
pub const DS_TYPE: ds_kind = 3;
pub const DS_EDGE: ds_kind = 4;
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
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct ds_shim {
    pub strings_of_cpp11: std::ffi::c_int,
    pub load: ::std::option::Option<
        unsafe extern "C" fn(options: *const *const std::ffi::c_char, count: usize) -> std::ffi::c_int,
    >,
    pub unload: ::std::option::Option<unsafe extern "C" fn() -> std::ffi::c_int>,
    pub close: ::std::option::Option<unsafe extern "C" fn() -> std::ffi::c_int>,
    pub register_names: ::std::option::Option<
        unsafe extern "C" fn(
            kind: ds_kind,
            names: *const *const std::ffi::c_char,
            count: usize,
            first: *mut u32,
        ) -> std::ffi::c_int,
    >,
    pub step: ::std::option::Option<unsafe extern "C" fn(until: f64) -> std::ffi::c_int>,
    pub time: ::std::option::Option<unsafe extern "C" fn(seconds: *mut f64) -> std::ffi::c_int>,
    pub read_lanes: ::std::option::Option<
        unsafe extern "C" fn(lanes: *const u32, count: usize, cars: *mut ds_cars) -> std::ffi::c_int,
    >,
    pub read_lights: ::std::option::Option<
        unsafe extern "C" fn(lights: *const u32, count: usize, states: *mut ds_states) -> std::ffi::c_int,
    >,
    pub set_lights: ::std::option::Option<
        unsafe extern "C" fn(lights: *const u32, count: usize, states: *const ds_states) -> std::ffi::c_int,
    >,
    pub set_programs: ::std::option::Option<
        unsafe extern "C" fn(lights: *const u32, count: usize, program: *const std::ffi::c_char) -> std::ffi::c_int,
    >,
    pub insert: ::std::option::Option<unsafe extern "C" fn(cars: *const ds_insertion, count: usize) -> std::ffi::c_int>,
    pub enter: ::std::option::Option<unsafe extern "C" fn(cars: *const ds_entering, count: usize) -> std::ffi::c_int>,
    pub place: ::std::option::Option<unsafe extern "C" fn(cars: *const ds_placing, count: usize) -> std::ffi::c_int>,
    pub seed_generators: ::std::option::Option<
        unsafe extern "C" fn(first: u32, seeds: *const u32, count: usize, counted: std::ffi::c_int) -> std::ffi::c_int,
    >,
    pub clear_pending: ::std::option::Option<unsafe extern "C" fn() -> std::ffi::c_int>,
    pub remove_cars: ::std::option::Option<unsafe extern "C" fn(lanes: *const u32, count: usize) -> std::ffi::c_int>,
    pub read_departures: ::std::option::Option<unsafe extern "C" fn(departures: *mut ds_departures) -> std::ffi::c_int>,
    pub read_departed:
        ::std::option::Option<unsafe extern "C" fn(count: *mut usize, cars: *mut *const u64) -> std::ffi::c_int>,
    pub read_gone:
        ::std::option::Option<unsafe extern "C" fn(count: *mut usize, cars: *mut *const u64) -> std::ffi::c_int>,
    pub read_route: ::std::option::Option<
        unsafe extern "C" fn(car: *const std::ffi::c_char, route: *mut ds_route) -> std::ffi::c_int,
    >,
    pub counts: ::std::option::Option<unsafe extern "C" fn(counts: *mut ds_counts) -> std::ffi::c_int>,
    pub count_waiting: ::std::option::Option<
        unsafe extern "C" fn(
            areas: *const u32,
            crossings: *const u32,
            count: usize,
            waiting: *mut u32,
        ) -> std::ffi::c_int,
    >,
    pub read_losses: ::std::option::Option<
        unsafe extern "C" fn(cars: *const *const std::ffi::c_char, count: usize, losses: *mut f64) -> std::ffi::c_int,
    >,
    pub read_stops: ::std::option::Option<
        unsafe extern "C" fn(cars: *const *const std::ffi::c_char, count: usize, stops: *mut u8) -> std::ffi::c_int,
    >,
    pub read_co2:
        ::std::option::Option<unsafe extern "C" fn(lanes: *const u32, count: usize, co2: *mut f64) -> std::ffi::c_int>,
    pub heard: ::std::option::Option<unsafe extern "C" fn() -> *const std::ffi::c_char>,
    pub shortcuts: ::std::option::Option<unsafe extern "C" fn() -> std::ffi::c_int>,
}
pub const DS_OTHER: ds_call = 0;
pub const DS_LOADING: ds_call = 1;
pub const DS_STEPPING: ds_call = 2;
pub type ds_call = std::ffi::c_uint;
unsafe extern "C" {
    pub fn ds_open(
        library: *const std::ffi::c_char,
        shim: *mut *const ds_shim,
        version: *mut *const std::ffi::c_char,
        file: *mut *const std::ffi::c_char,
    ) -> std::ffi::c_int;
    pub fn ds_take_shortcuts();
    pub fn ds_few_devices(few: std::ffi::c_int);
    pub fn ds_guard();
    pub fn ds_name(what: *const std::ffi::c_char, way_out: *const std::ffi::c_char);
    pub fn ds_limit(load_s: u64, step_s: u64, memory_mib: u64);
    pub fn ds_enter(call: ds_call, second: u64);
    pub fn ds_leave();
    pub fn ds_open_bytes(bytes: *const std::ffi::c_void, size: usize) -> std::ffi::c_int;
    pub fn ds_last_error() -> *const std::ffi::c_char;
    pub fn ds_own_file() -> *const std::ffi::c_char;
    pub fn ds_c_library() -> *const std::ffi::c_char;
}
