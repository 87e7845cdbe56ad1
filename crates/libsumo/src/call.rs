//! The one crossing to C: converts, calls, checks, and turns a code and its message into an error.
//!
//! All calls into a simulation are in this file. Six other files of this crate have `unsafe` code, too: `library` opens
//! libsumo, `stand_ins` opens what it misses, `shortcuts` takes shortcuts in it once it is open, `guard` watches the calls,
//! `places` asks where our own file lies, and `ffi` declares the shim's functions.

use std::cell::Cell;
use std::ffi::{CStr, CString, c_char, c_int};
use std::io::Write;
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::ptr;
use std::slice;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::error::{Error, Result};
use super::events::{DepartSpeed, Departure, Entering, Insertion, Placing, RouteNow, StepCounts};
use super::ffi;
use super::guard::{Call, Inside};
use super::ids::{CarId, EdgeId, LaneId, LightId};
use super::library::{self, Library};
use super::signal::SignalState;
use super::table::CarTable;
use super::version::Version;

/// Lock of the right to cross, because libsumo keeps its one simulation in globals without any lock.
static TURN: Mutex<()> = Mutex::new(());

thread_local! {
    /// Whether this thread has the turn. A second wait in the same thread would never end.
    static HAS_TURN: Cell<bool> = const { Cell::new(false) };
}

/// The kinds of things that can be registered by name.
#[derive(Clone, Copy, Debug)]
pub(crate) enum IdKind {
    Lane,
    Light,
    Route,
    Type,
    Edge,
}

/// The right to cross. While it lives, no other thread is inside libsumo. When it is dropped, so is the simulation.
///
/// It is neither `Send` (the guard of [`TURN`] is not) nor `Sync` (two threads with a reference would be two threads
/// inside).
#[derive(Debug)]
pub(crate) struct Crossing {
    library: &'static Library,
    /// Seconds since the last load.
    pub(crate) second: u64,
    not_sync: PhantomData<*const ()>,
    _turn: MutexGuard<'static, ()>,
}

/// Calls a function of the shim.
macro_rules! call {
    ($crossing:ident.$function:ident($($argument:expr),*)) => {
        call!(Call::Other, $crossing.$function($($argument),*))
    };
    ($call:expr, $crossing:ident.$function:ident($($argument:expr),*)) => {{
        let _inside = Inside::enter($call, $crossing.second);
        ($crossing.library.shim.$function.expect(WHOLE))($($argument),*)
    }};
}

/// The version from which on SUMO writes the number of draws before the state of a generator (tried with all from 1.15 to 1.28).
const STATES_WITH_COUNTS: Version = Version { major: 1, minor: 24, patch: 0 };

/// The shim has all functions of its table.
const WHOLE: &str = "shim.cpp fills its table";

impl Crossing {
    /// Waits until no other thread has the turn. Loads libsumo, if that has not happened yet.
    pub(crate) fn wait() -> Result<Self> {
        if HAS_TURN.get() {
            return Err(Error::AlreadyHeld);
        }
        let library = library::load()?;
        // A panic elsewhere poisons the lock but leaves no call half-done: unwinding closed its simulation.
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        HAS_TURN.set(true);
        Ok(Crossing { library, second: 0, not_sync: PhantomData, _turn: turn })
    }

    pub(crate) fn load(&mut self, options: &[impl AsRef<str>]) -> Result<()> {
        self.second = 0;
        let options: Vec<&str> = options.iter().map(AsRef::as_ref).collect();
        let texts = Texts::new(&with_silence(&options))?;
        // SAFETY: we have the turn; the pointers are `len` strings that end in zero and outlive the call.
        let code = unsafe { call!(Call::Load, self.load(texts.pointers.as_ptr(), texts.pointers.len())) };
        ask(code).map_err(|text| Error::Load { options: options.join(" "), text })
    }

    /// Ends the simulation. Registered names stay.
    pub(crate) fn unload(&mut self) -> Result<()> {
        // SAFETY: we have the turn.
        check(unsafe { call!(self.unload()) }, "end the simulation")
    }

    /// Returns what SUMO wrote to the terminal in the last call.
    pub(crate) fn heard(&self) -> String {
        // SAFETY: we have the turn, so no call changes the string, which ends in zero.
        unsafe { CStr::from_ptr(call!(self.heard())) }.to_string_lossy().into_owned()
    }

    /// Registers all or none. Returns the number of the first one; the others follow.
    pub(crate) fn register(&mut self, kind: IdKind, names: &[impl AsRef<str>]) -> Result<u32> {
        let texts = Texts::new(names)?;
        let (kind, action) = match kind {
            IdKind::Lane => (ffi::DS_LANE, "register the lanes"),
            IdKind::Light => (ffi::DS_LIGHT, "register the lights"),
            IdKind::Route => (ffi::DS_ROUTE, "register the routes"),
            IdKind::Type => (ffi::DS_TYPE, "register the vehicle types"),
            IdKind::Edge => (ffi::DS_EDGE, "register the edges"),
        };
        let mut first = 0;
        // SAFETY: as in `load`; `first` outlives the call.
        let code =
            unsafe { call!(self.register_names(kind, texts.pointers.as_ptr(), texts.pointers.len(), &mut first)) };
        check(code, action)?;
        Ok(first)
    }

    /// Lets cars that are made from now on have all devices, or few.
    pub(crate) fn few_devices(&mut self, few: bool) {
        // SAFETY: we have the turn, so SUMO makes no car.
        unsafe { ffi::ds_few_devices(few.into()) }
    }

    /// Returns the bits of the shortcuts that are taken.
    pub(crate) fn shortcuts(&self) -> i32 {
        // SAFETY: as in `heard`.
        unsafe { call!(self.shortcuts()) }
    }

    pub(crate) fn step(&mut self, until_s: f64) -> Result<()> {
        // SAFETY: we have the turn.
        check(unsafe { call!(Call::Step, self.step(until_s)) }, "make a step")
    }

    pub(crate) fn count_waiting(&mut self, ways: &[[EdgeId; 2]], waiting: &mut Vec<u32>) -> Result<()> {
        let of = |side: usize| -> Vec<u32> { ways.iter().map(|way| way[side].0).collect() };
        let [areas, crossings] = [0, 1].map(of);
        waiting.clear();
        waiting.resize(ways.len(), 0);
        // SAFETY: we have the turn; all three have `len` elements and outlive the call.
        let code =
            unsafe { call!(self.count_waiting(areas.as_ptr(), crossings.as_ptr(), ways.len(), waiting.as_mut_ptr())) };
        check(code, "count the persons that wait")
    }

    pub(crate) fn losses_s(&mut self, cars: &[impl AsRef<str>]) -> Result<Vec<f64>> {
        let texts = Texts::new(cars)?;
        let mut losses = vec![0.0; cars.len()];
        // SAFETY: we have the turn; the pointers are `len` strings that end in zero; all outlive the call.
        let code = unsafe { call!(self.read_losses(texts.pointers.as_ptr(), cars.len(), losses.as_mut_ptr())) };
        check(code, "read the time that cars have lost").map(|()| losses)
    }

    pub(crate) fn at_stops(&mut self, cars: &[impl AsRef<str>]) -> Result<Vec<bool>> {
        let texts = Texts::new(cars)?;
        let mut stops = vec![0_u8; cars.len()];
        // SAFETY: as in `losses_s`.
        let code = unsafe { call!(self.read_stops(texts.pointers.as_ptr(), cars.len(), stops.as_mut_ptr())) };
        check(code, "read which cars make a stop")?;
        Ok(stops.into_iter().map(|stop| stop != 0).collect())
    }

    pub(crate) fn co2_mg_per_s(&mut self, lanes: &[LaneId], co2: &mut Vec<f64>) -> Result<()> {
        co2.clear();
        co2.resize(lanes.len(), 0.0);
        // SAFETY: we have the turn; a `LaneId` is laid out as a `u32`; both have `len` elements and outlive the call.
        let code = unsafe { call!(self.read_co2(lanes.as_ptr().cast(), lanes.len(), co2.as_mut_ptr())) };
        check(code, "read the emissions on lanes")
    }

    pub(crate) fn time_s(&self) -> Result<f64> {
        let mut seconds = 0.0;
        // SAFETY: we have the turn, and `Crossing` is not `Sync`, so a shared reference is as good as an exclusive one.
        check(unsafe { call!(self.time(&mut seconds)) }, "return the time")?;
        Ok(seconds)
    }

    pub(crate) fn read_lanes(&mut self, lanes: &[LaneId], table: &mut CarTable) -> Result<()> {
        let mut read = MaybeUninit::uninit();
        // SAFETY: we have the turn; a `LaneId` is laid out as a `u32`; `read` is only written to.
        let code = unsafe { call!(self.read_lanes(lanes.as_ptr().cast(), lanes.len(), read.as_mut_ptr())) };
        check(code, "read the lanes")?;
        // SAFETY: the call succeeded, so `read` is written. Its arrays are valid until the next call, which needs
        // `&mut self`. `starts` has an entry per lane and a last one, which is the length of the other three.
        unsafe {
            let read = read.assume_init();
            let starts = array(read.starts, lanes.len() + 1);
            let cars = starts[lanes.len()] as usize;
            table.fill(starts, array(read.cars, cars), array(read.positions, cars), array(read.speeds, cars));
        }
        Ok(())
    }

    /// Passes the letters of each light to `each`, in the order of `lights`.
    pub(crate) fn read_lights(&mut self, lights: &[LightId], mut each: impl FnMut(&str) -> Result<()>) -> Result<()> {
        let mut read = MaybeUninit::uninit();
        // SAFETY: as in `read_lanes`.
        let code = unsafe { call!(self.read_lights(lights.as_ptr().cast(), lights.len(), read.as_mut_ptr())) };
        check(code, "read the lights")?;
        // SAFETY: as in `read_lanes`; the last entry of `starts` is the length of `letters`.
        let (starts, letters) = unsafe {
            let read = read.assume_init();
            let starts = array(read.starts, lights.len() + 1);
            (starts, array(read.letters.cast::<u8>(), starts[lights.len()] as usize))
        };
        for ends in starts.windows(2) {
            each(&text_between(letters, ends))?;
        }
        Ok(())
    }

    /// Sets the lights. There is one state per light, with as many letters as its light has links.
    pub(crate) fn set_lights(&mut self, lights: &[LightId], states: &[&SignalState]) -> Result<()> {
        let mut letters = Vec::new();
        let mut starts = vec![0];
        for state in states {
            letters.extend_from_slice(state.as_str().as_bytes());
            starts.push(letters.len() as u32);
        }
        let states = ffi::ds_states { starts: starts.as_ptr(), letters: letters.as_ptr().cast() };
        // SAFETY: we have the turn; a `LightId` is laid out as a `u32`; `starts` has an entry per light and a last one,
        // none of them beyond `letters`.
        let code = unsafe { call!(self.set_lights(lights.as_ptr().cast(), lights.len(), &states)) };
        check(code, "set the lights")
    }

    pub(crate) fn set_programs(&mut self, lights: &[LightId], program: &str) -> Result<()> {
        let program = terminated(program)?;
        // SAFETY: we have the turn; a `LightId` is laid out as a `u32`; `program` ends in zero and outlives the call.
        let code = unsafe { call!(self.set_programs(lights.as_ptr().cast(), lights.len(), program.as_ptr())) };
        check(code, "set the lights' programs")
    }

    pub(crate) fn insert(&mut self, cars: &[Insertion]) -> Result<()> {
        let insertion = |car: &Insertion| ffi::ds_insertion {
            car: car.car,
            position: car.position_m,
            speed: speed_of(car.speed),
            route: car.route.0,
        };
        self.pass(self.library.shim.insert, cars.iter().map(insertion), "add a car")
    }

    pub(crate) fn enter(&mut self, cars: &[Entering]) -> Result<()> {
        let entering = |car: &Entering| ffi::ds_entering {
            car: car.insertion.car,
            position: car.insertion.position_m,
            speed: speed_of(car.insertion.speed),
            speed_factor: car.speed_factor,
            end: car.end_m.unwrap_or(-1.0),
            route: car.insertion.route.0,
            type_: car.vehicle_type.0,
            lane: car.lane.unwrap_or(u32::MAX),
        };
        self.pass(self.library.shim.enter, cars.iter().map(entering), "add a car")
    }

    pub(crate) fn place(&mut self, cars: &[Placing]) -> Result<()> {
        let placing = |car: &Placing| ffi::ds_placing {
            car: car.car,
            position: car.position_m,
            speed: car.speed_mps,
            lane: car.lane.0,
        };
        self.pass(self.library.shim.place, cars.iter().map(placing), "place a car")
    }

    pub(crate) fn remove_cars(&mut self, lanes: &[LaneId]) -> Result<()> {
        self.pass(self.library.shim.remove_cars, lanes.iter().map(|lane| lane.0), "remove the cars")
    }

    /// Passes values to a function of the shim that reads an array and its length.
    fn pass<T>(
        &mut self,
        function: Option<unsafe extern "C" fn(*const T, usize) -> c_int>,
        values: impl Iterator<Item = T>,
        action: &'static str,
    ) -> Result<()> {
        let values: Vec<T> = values.collect();
        let _inside = Inside::enter(Call::Other, self.second);
        // SAFETY: we have the turn; pointer and length are those of one vector.
        check(unsafe { function.expect(WHOLE)(values.as_ptr(), values.len()) }, action)
    }

    pub(crate) fn seed_generators(&mut self, first: u32, seeds: &[u32]) -> Result<()> {
        let counted = self.library.version >= STATES_WITH_COUNTS;
        // SAFETY: we have the turn; pointer and length are those of one slice.
        let code = unsafe { call!(self.seed_generators(first, seeds.as_ptr(), seeds.len(), counted.into())) };
        check(code, "seed the lanes")
    }

    pub(crate) fn clear_pending(&mut self) -> Result<()> {
        // SAFETY: we have the turn.
        check(unsafe { call!(self.clear_pending()) }, "drop the waiting cars")
    }

    pub(crate) fn departures(&mut self) -> Result<Vec<Departure>> {
        let mut read = MaybeUninit::uninit();
        // SAFETY: as in `read_lanes`.
        check(unsafe { call!(self.read_departures(read.as_mut_ptr())) }, "read the departures")?;
        // SAFETY: as in `read_lanes`. `starts` has five entries per car and a last one, which is the length of
        // `letters`. The other arrays have an entry per car.
        let (starts, letters, cars, lanes, positions, speeds, factors) = unsafe {
            let read: ffi::ds_departures = read.assume_init();
            let starts = array(read.starts, 5 * read.count + 1);
            (
                starts,
                array(read.letters.cast::<u8>(), starts[5 * read.count] as usize),
                array(read.cars, read.count),
                array(read.lanes, read.count),
                array(read.positions, read.count),
                array(read.speeds, read.count),
                array(read.speed_factors, read.count),
            )
        };
        let text = |number: usize| text_between(letters, &starts[number..]);
        Ok((0..cars.len())
            .map(|car| Departure {
                id: CarId(cars[car]),
                name: text(5 * car),
                vehicle_type: text(5 * car + 1),
                vehicle_class: text(5 * car + 2),
                route: text(5 * car + 3),
                edges: edges(&text(5 * car + 4)),
                lane: lanes[car],
                position_m: positions[car],
                speed_mps: speeds[car],
                speed_factor: factors[car],
            })
            .collect())
    }

    pub(crate) fn departed(&mut self) -> Result<Vec<CarId>> {
        self.cars(self.library.shim.read_departed, "read which cars have departed")
    }

    pub(crate) fn gone(&mut self) -> Result<Vec<CarId>> {
        self.cars(self.library.shim.read_gone, "read which cars have left the road")
    }

    /// Returns the numbers of the cars that a function of the shim lists.
    fn cars(
        &mut self,
        list: Option<unsafe extern "C" fn(*mut usize, *mut *const u64) -> c_int>,
        what: &'static str,
    ) -> Result<Vec<CarId>> {
        let (mut count, mut cars) = (0, ptr::null());
        let _inside = Inside::enter(Call::Other, self.second);
        // SAFETY: we have the turn; both are only written to.
        check(unsafe { list.expect(WHOLE)(&mut count, &mut cars) }, what)?;
        // SAFETY: the call succeeded, so there are `count` numbers. They are valid until the next call, which needs
        // `&mut self`.
        let cars = unsafe { array(cars, count) };
        Ok(cars.iter().copied().map(CarId).collect())
    }

    pub(crate) fn route(&mut self, car: &str) -> Result<RouteNow> {
        let car = terminated(car)?;
        let mut read = MaybeUninit::uninit();
        // SAFETY: we have the turn; `car` ends in zero and outlives the call; `read` is only written to.
        check(unsafe { call!(self.read_route(car.as_ptr(), read.as_mut_ptr())) }, "read the route of a car")?;
        // SAFETY: the call succeeded, so `read` is written. Its text ends in zero and is valid until the next call, which
        // needs `&mut self`.
        let (text, at) = unsafe {
            let read: ffi::ds_route = read.assume_init();
            (CStr::from_ptr(read.edges).to_string_lossy(), read.at)
        };
        Ok(RouteNow { edges: edges(&text), at: at as usize })
    }

    pub(crate) fn counts(&mut self) -> Result<StepCounts> {
        let mut counts = MaybeUninit::uninit();
        // SAFETY: we have the turn; `counts` is only written to.
        check(unsafe { call!(self.counts(counts.as_mut_ptr())) }, "count")?;
        // SAFETY: the call succeeded, so it is written.
        let counts: ffi::ds_counts = unsafe { counts.assume_init() };
        Ok(StepCounts {
            departed: counts.departed,
            arrived: counts.arrived,
            pending: counts.pending,
            teleports: counts.teleports,
            collisions: counts.collisions,
            emergency_stops: counts.emergency_stops,
        })
    }
}

impl Drop for Crossing {
    fn drop(&mut self) {
        // SAFETY: we still have the turn: the lock's guard is a field, and fields are dropped after this.
        // SUMO's message while it closes (for example, of a full disk) is lost, because no caller could receive it.
        let _ = unsafe { call!(self.close()) };
        self.few_devices(false);
        HAS_TURN.set(false);
    }
}

pub(crate) fn c_library() -> String {
    // SAFETY: the text ends in zero and lives as long as the process.
    unsafe { CStr::from_ptr(ffi::ds_c_library()) }.to_string_lossy().into_owned()
}

/// Writes the shortest decimal that reads back as the same number, and returns its length. The shim calls it.
///
/// # Safety
/// `text` has room for `room` bytes.
#[unsafe(no_mangle)]
unsafe extern "C" fn ds_decimal(number: f64, text: *mut c_char, room: usize) -> usize {
    // SAFETY: the caller's promise.
    let mut text = unsafe { slice::from_raw_parts_mut(text.cast::<u8>(), room) };
    write!(text, "{number}").expect("the shim has room for every number");
    room - text.len()
}

/// Returns a speed as the shim takes it: a negative one means `max`.
fn speed_of(speed: DepartSpeed) -> f64 {
    match speed {
        DepartSpeed::Max => -1.0,
        DepartSpeed::Fixed(speed_mps) => speed_mps,
    }
}

/// # Safety
/// `pointer` is the beginning of `length` values that hold until the next call, or `length` is 0.
unsafe fn array<'a, T>(pointer: *const T, length: usize) -> &'a [T] {
    if length == 0 {
        return &[]; // The pointer of an empty std::vector may be null.
    }
    // SAFETY: the caller's promise.
    unsafe { slice::from_raw_parts(pointer, length) }
}

/// Returns the names of edges that the shim wrote into one text.
fn edges(text: &str) -> Vec<String> {
    text.split('\u{1f}').map(str::to_owned).collect()
}

/// Returns the text that begins at the first of `starts` and ends before the second.
fn text_between(letters: &[u8], starts: &[u32]) -> String {
    String::from_utf8_lossy(&letters[starts[0] as usize..starts[1] as usize]).into_owned()
}

fn check(code: c_int, action: &'static str) -> Result<()> {
    ask(code).map_err(|text| Error::Refused { action, text })
}

/// Returns SUMO's message, as an error, if the call that returned `code` failed.
pub(crate) fn ask(code: c_int) -> std::result::Result<(), String> {
    if code == 0 {
        return Ok(());
    }
    // SAFETY: the message is this thread's own and always a string that ends in zero.
    let message = unsafe { CStr::from_ptr(ffi::ds_last_error()) }.to_string_lossy();
    Err(tidy(&message))
}

/// Returns SUMO's words in one line, without those that carry no information.
fn tidy(message: &str) -> String {
    let mut lines: Vec<&str> = Vec::new();
    for line in message.lines() {
        let line = line.trim();
        let line = line.strip_prefix("Error: ").unwrap_or(line);
        if !matches!(line, "" | "Process Error" | "Quitting (on error).") && !lines.contains(&line) {
            lines.push(line);
        }
    }
    if lines.is_empty() { "it gave no reason".into() } else { lines.join(" ") }
}

/// Options that silence SUMO and stop it from looking up XML schemas on the network. An option that the caller sets is
/// left to the caller, because SUMO refuses an option that is set twice.
const SILENCE: [[&str; 2]; 4] = [
    ["--no-step-log", "true"],
    ["--no-warnings", "true"],
    ["--duration-log.disable", "true"],
    ["--xml-validation", "never"],
];

fn with_silence<'a>(options: &[&'a str]) -> Vec<&'a str> {
    let sets = |option: &str| options.iter().any(|given| given.split('=').next() == Some(option));
    let silence = SILENCE.iter().filter(|[option, _]| !sets(option)).flatten();
    options.iter().chain(silence).copied().collect()
}

/// Strings in C's form: `pointers` point into `owned`.
struct Texts {
    _owned: Vec<CString>,
    pointers: Vec<*const c_char>,
}

impl Texts {
    fn new(texts: &[impl AsRef<str>]) -> Result<Self> {
        let owned = texts.iter().map(|text| terminated(text.as_ref())).collect::<Result<Vec<_>>>()?;
        let pointers = owned.iter().map(|text| text.as_ptr()).collect();
        Ok(Texts { _owned: owned, pointers })
    }
}

fn terminated(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error::ZeroByte { text: text.into() })
}

#[cfg(test)]
mod tests {
    use super::with_silence;

    #[test]
    fn an_option_of_the_callers_is_not_set_a_second_time() {
        let options = with_silence(&["--no-warnings=false", "--xml-validation", "always"]);
        assert_eq!(
            options.join(" "),
            "--no-warnings=false --xml-validation always --no-step-log true --duration-log.disable true"
        );
    }
}
