// The plain-C side of libsumo. See shim.h for the rules of every function.
//
// This file is compiled twice: for std::string as it was before C++11, and as it is since. A libsumo has one of them. open.cpp
// chooses.

#include "inside.h"
#include "open.h"
#include "shim.h"
#include "sumo.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <iostream>
#include <random>
#include <sstream>
#include <stdexcept>
#include <streambuf>
#include <string>
#include <vector>

namespace {

// Registered names, by kind and index, as std::string so that no call has to make one.
std::vector<std::string> names_of[5];

// SUMO's lanes by index, as long as a net is loaded, if cars are read from them without names.
std::vector<const void *> inner_lanes;
Identities identities;
bool reads_inner_lanes = false;

// What is known of the layout of SUMO's generators.
enum class Layout { unknown, as_here, other };
Layout layout_of_generators = Layout::other;

// Cars that were added since the last step: SUMO does not list them as pending yet.
std::vector<std::string> fresh;

// Number of cars that were taken off the road since the last step. SUMO lists them as arrived.
uint32_t removed = 0;

// Collects what SUMO writes to the terminal while we are inside: the beginning, because a broken network can bring an
// error for each of a million elements.
class Ear : public std::streambuf {
public:
    static constexpr size_t most = 16 * 1024;
    std::string heard;

protected:
    int_type overflow(int_type letter) override {
        if (!traits_type::eq_int_type(letter, traits_type::eof()) && heard.size() < most) {
            heard.push_back(traits_type::to_char_type(letter));
        }
        return traits_type::not_eof(letter);
    }

    std::streamsize xsputn(const char *text, std::streamsize length) override {
        heard.append(text, std::min(static_cast<size_t>(length), most - std::min(most, heard.size())));
        return length;
    }
};

// Redirects std::cerr and std::cout to the ear. A failed load throws a bare "Process Error" and writes the real reason
// to std::cerr, whatever --error-log says (measured on SUMO 1.15). Output of other threads to these C++ streams is
// redirected too during that time; Rust's own output is not.
class Hush {
public:
    Hush() : cerr_(std::cerr.rdbuf(&ear)), cout_(std::cout.rdbuf(&ear)) { ear.heard.clear(); }
    ~Hush() {
        std::cout.rdbuf(cout_);
        std::cerr.rdbuf(cerr_);
    }
    Hush(const Hush &) = delete;
    Hush &operator=(const Hush &) = delete;

    static Ear ear;

private:
    std::streambuf *cerr_;
    std::streambuf *cout_;
};
Ear Hush::ear;

// Runs `work` in silence and turns any exception into a code. TraCIException, FatalTraCIError, ProcessError and IOError
// all occur, and all are std::exceptions.
template <typename Work> int guarded(Work work) noexcept {
    Hush hush;
    try {
        work();
        return 0;
    } catch (const std::exception &error) {
        return ds_failed(error.what(), Hush::ear.heard.c_str());
    } catch (...) {
        return ds_failed("an exception of unknown type", Hush::ear.heard.c_str());
    }
}

const std::string &name(ds_kind kind, uint32_t index) {
    static const char *const words[] = {"lane", "light", "route", "type", "edge"};
    if (index >= names_of[kind].size()) {
        throw std::out_of_range(std::string("no ") + words[kind] + " is registered under number " + std::to_string(index));
    }
    return names_of[kind][index];
}

// Throws SUMO's own message, which contains the name, if the net has no such thing.
void must_exist(ds_kind kind, const std::string &name) {
    switch (kind) {
    case DS_LANE:
        Lane::getLength(name);
        break;
    case DS_LIGHT:
        TrafficLight::getPhase(name);
        break;
    case DS_ROUTE:
        Route::getParameter(name, "");
        break;
    case DS_TYPE:
        VehicleType::getLength(name);
        break;
    case DS_EDGE:
        Edge::getLaneNumber(name);
        break;
    }
}

// Returns the shortest text that reads back as the same number, whatever the locale.
std::string decimal(double number) {
    char digits[400]; // The longest has 327.
    return std::string(digits, ds_decimal(number, digits, sizeof digits));
}

// Returns a car's name as a number: its value if it is decimal without leading zeros and fits 63 bits, else FNV-1a 64 with the
// top bit set. So the cars 7 and 07 differ.
uint64_t identity(const std::string &name) {
    constexpr uint64_t top = uint64_t(1) << 63;
    uint64_t value = 0;
    const char *const end = name.data() + name.size();
    const auto read = std::from_chars(name.data(), end, value);
    const bool is_padded = name.size() > 1 && name[0] == '0';
    if (!is_padded && read.ec == std::errc() && read.ptr == end && value < top) {
        return value;
    }
    uint64_t hash = 0xcbf29ce484222325u;
    for (const char letter : name) {
        hash = (hash ^ static_cast<unsigned char>(letter)) * 0x100000001b3u;
    }
    return hash | top;
}

// Returns the edges of a car's route. Names may hold blanks, but no XML holds the separator.
std::string edges_of(const std::string &car) {
    std::string edges;
    for (const auto &edge : Vehicle::getRoute(car)) {
        edges.append(edges.empty() ? "" : "\x1f").append(edge);
    }
    return edges;
}

void forget_step() {
    fresh.clear();
    removed = 0;
}

// Adds a car that departs in the next step.
void add(Text serial, Text route, Text type, Text lane, Text position, Text speed, Text end) {
    static const std::string now = "now", current = "current", none;
    Vehicle::add(serial, route, type, now, lane, position, speed, current, end, current, none, none, none, 4, 0);
    fresh.push_back(serial);
}

void find_inner_lanes(size_t from) {
    const auto &names = names_of[DS_LANE];
    for (size_t i = from; reads_inner_lanes && i < names.size(); ++i) {
        inner_lanes.push_back(lane_named(names[i]));
    }
}

void forget_inner_lanes() {
    inner_lanes.clear();
    if (reads_inner_lanes) {
        identities.clear();
    }
}

// Returns a lane that can be read without names, or null.
const void *inner_lane(uint32_t lane) {
    return reads_inner_lanes && lane < inner_lanes.size() ? inner_lanes[lane] : nullptr;
}

int ds_load(const char *const *options, size_t count) {
    return guarded([&] {
        forget_step();
        forget_inner_lanes();
        Simulation::load(std::vector<std::string>(options, options + count));
        if (!Simulation::isLoaded()) {
            throw std::runtime_error("These options load no network."); // Such as --help.
        }
        for (const auto kind : {DS_LANE, DS_LIGHT, DS_ROUTE, DS_TYPE, DS_EDGE}) {
            for (const auto &name : names_of[kind]) {
                must_exist(kind, name);
            }
        }
        find_inner_lanes(0);
    });
}

int ds_unload(void) {
    return guarded([] {
        forget_step();
        forget_inner_lanes();
        Simulation::close("Libsumo requested termination.");
    });
}

int ds_close(void) {
    for (auto &names : names_of) {
        names.clear();
    }
    return ds_unload();
}

int ds_register_names(enum ds_kind kind, const char *const *names, size_t count, uint32_t *first) {
    return guarded([&] {
        const std::vector<std::string> wanted(names, names + count);
        const bool is_loaded = Simulation::isLoaded();
        for (const auto &name : wanted) {
            if (is_loaded) {
                must_exist(kind, name);
            }
        }
        auto &known = names_of[kind];
        *first = static_cast<uint32_t>(known.size());
        known.insert(known.end(), wanted.begin(), wanted.end());
        if (kind == DS_LANE && is_loaded) {
            find_inner_lanes(*first);
        }
    });
}

int ds_step(double until) {
    return guarded([=] {
        forget_step();
        Simulation::step(until);
    });
}

int ds_time(double *seconds) {
    return guarded([&] { *seconds = Simulation::getTime(); });
}

// The cars of some lanes, one array for each of what is read.
struct Cars {
    std::vector<uint32_t> starts;
    std::vector<uint64_t> cars;
    std::vector<double> positions, speeds;

    void begin() {
        starts.assign(1, 0);
        cut(0);
    }
    void cut(size_t count) {
        cars.resize(count);
        positions.resize(count);
        speeds.resize(count);
    }
    void push(uint64_t car, double position, double speed) {
        cars.push_back(car);
        positions.push_back(position);
        speeds.push_back(speed);
    }
    void end_lane() { starts.push_back(static_cast<uint32_t>(cars.size())); }
};

// Reads a lane by the names of its cars.
void read_by_names(uint32_t lane, Cars &read) {
    for (const auto &car : Lane::getLastStepVehicleIDs(name(DS_LANE, lane))) {
        read.push(identity(car), Vehicle::getLanePosition(car), Vehicle::getSpeed(car));
    }
}

// Reads a lane without a name. Where a car is new, reads it by names, too. If the two differ, it is the last time.
void read_inside(uint32_t lane, Cars &read) {
    const auto &found = cars_on(inner_lanes[lane]);
    const size_t first = read.cars.size();
    bool are_known = true;
    for (const void *car : found) {
        const uint64_t *const known = identities.of(number_of(car));
        are_known = are_known && known != nullptr;
        read.push(known == nullptr ? 0 : *known, position_of(car), speed_of(car));
    }
    if (are_known) {
        return;
    }
    Cars named;
    read_by_names(lane, named);
    const auto has = [&](const std::vector<double> &all, const std::vector<double> &same) {
        return std::equal(all.begin() + static_cast<std::ptrdiff_t>(first), all.end(), same.begin(), same.end());
    };
    reads_inner_lanes = has(read.positions, named.positions) && has(read.speeds, named.speeds);
    read.cut(first);
    for (size_t i = 0; i < named.cars.size(); ++i) {
        read.push(named.cars[i], named.positions[i], named.speeds[i]);
        if (reads_inner_lanes) {
            identities.keep(number_of(found[i]), named.cars[i]);
        }
    }
}

int ds_read_lanes(const uint32_t *lanes, size_t count, struct ds_cars *out) {
    static Cars read;
    return guarded([&] {
        read.begin();
        for (size_t i = 0; i < count; ++i) {
            if (inner_lane(lanes[i]) != nullptr) {
                read_inside(lanes[i], read);
            } else {
                read_by_names(lanes[i], read);
            }
            read.end_lane();
        }
        *out = {read.starts.data(), read.cars.data(), read.positions.data(), read.speeds.data()};
    });
}

int ds_read_lights(const uint32_t *lights, size_t count, struct ds_states *out) {
    static std::vector<uint32_t> starts;
    static std::string letters;
    return guarded([&] {
        starts.assign(1, 0);
        letters.clear();
        for (size_t i = 0; i < count; ++i) {
            letters += TrafficLight::getRedYellowGreenState(name(DS_LIGHT, lights[i]));
            starts.push_back(static_cast<uint32_t>(letters.size()));
        }
        *out = {starts.data(), letters.data()};
    });
}

int ds_set_lights(const uint32_t *lights, size_t count, const struct ds_states *states) {
    static std::string state;
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            state.assign(states->letters + states->starts[i], states->letters + states->starts[i + 1]);
            TrafficLight::setRedYellowGreenState(name(DS_LIGHT, lights[i]), state);
        }
    });
}

int ds_set_programs(const uint32_t *lights, size_t count, const char *program) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            TrafficLight::setProgram(name(DS_LIGHT, lights[i]), program);
        }
    });
}

int ds_insert(const struct ds_insertion *cars, size_t count) {
    static const std::string type = "car", lane = "first", max = "max";
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            const auto &car = cars[i];
            const std::string serial = std::to_string(car.car);
            add(serial, name(DS_ROUTE, car.route), type, lane, decimal(car.position), car.speed < 0 ? max : decimal(car.speed), max);
        }
    });
}

int ds_enter(const struct ds_entering *cars, size_t count) {
    static const std::string max = "max", first = "first";
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            const auto &car = cars[i];
            const std::string serial = std::to_string(car.car);
            add(serial, name(DS_ROUTE, car.route), name(DS_TYPE, car.type), car.lane == UINT32_MAX ? first : std::to_string(car.lane),
                decimal(car.position), car.speed < 0 ? max : decimal(car.speed), car.end < 0 ? max : decimal(car.end));
            // SUMO has drawn one from a generator that all cars share.
            Vehicle::setSpeedFactor(serial, car.speed_factor);
        }
    });
}

int ds_place(const struct ds_placing *cars, size_t count) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            const auto &car = cars[i];
            const std::string serial = std::to_string(car.car);
            Vehicle::moveTo(serial, name(DS_LANE, car.lane), car.position, move_automatic);
            Vehicle::setPreviousSpeed(serial, car.speed, invalid_double);
            // It is on the road, and no longer one of those that wait.
            fresh.erase(std::remove(fresh.begin(), fresh.end(), serial), fresh.end());
        }
    });
}

// With fewer draws SUMO would read no more, and draw that often.
constexpr unsigned long long counted_draws = 1000000;

// Seeds a generator as SUMO loads a saved state: from text.
void seed_by_text(uint32_t index, uint32_t seed, bool counted) {
    std::ostringstream state;
    if (counted) {
        state << counted_draws << ' ';
    }
    state << std::mt19937(seed);
    load_generator(static_cast<int>(index), state.str());
}

// Returns whether a generator that was seeded by text is in SUMO's memory where it is expected.
bool lies_as_here(uint32_t index, uint32_t seed, bool counted) {
    const std::mt19937 engine(seed);
    const auto bytes = reinterpret_cast<const std::vector<char> *>(generators)->size();
    return bytes % sizeof(Generator) == 0 && index < generators->size() &&
           std::memcmp(&(*generators)[index].engine, &engine, sizeof engine) == 0 &&
           (!counted || (*generators)[index].count == counted_draws);
}

int ds_seed_generators(uint32_t first, const uint32_t *seeds, size_t count, int counted) {
    return guarded([&] {
        if (!load_generator.is_found()) {
            throw std::runtime_error("this SUMO has no " + load_generator.words());
        }
        for (size_t i = 0; i < count; ++i) {
            const auto index = static_cast<uint32_t>(first + i);
            if (layout_of_generators == Layout::as_here && index < generators->size()) {
                auto &generator = (*generators)[index];
                generator.engine.seed(seeds[i]);
                if (counted) {
                    generator.count = counted_draws;
                }
                continue;
            }
            seed_by_text(index, seeds[i], counted);
            if (layout_of_generators == Layout::unknown) {
                layout_of_generators = lies_as_here(index, seeds[i], counted) ? Layout::as_here : Layout::other;
            }
        }
    });
}

int ds_clear_pending(void) {
    return guarded([] {
        // clearPending drops only cars that a step has already tried to insert. A car that was added after the last
        // step survives it and would enter in the next one (measured on SUMO 1.15). Unlike a car on the road, such a
        // car disappears at once when it is removed, and is not listed as arrived.
        Simulation::clearPending("");
        for (const auto &car : fresh) {
            Vehicle::remove(car, remove_vaporized);
        }
        fresh.clear();
    });
}

int ds_remove_cars(const uint32_t *lanes, size_t count) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            if (const void *lane = inner_lane(lanes[i]); lane != nullptr && cars_on(lane).empty()) {
                continue;
            }
            for (const auto &car : Lane::getLastStepVehicleIDs(name(DS_LANE, lanes[i]))) {
                Vehicle::remove(car, remove_vaporized);
                ++removed;
            }
        }
    });
}

int ds_read_departures(struct ds_departures *out) {
    static std::vector<uint32_t> starts, lanes;
    static std::string letters;
    static std::vector<uint64_t> cars;
    static std::vector<double> positions, speeds, speed_factors;
    return guarded([&] {
        starts.assign(1, 0);
        lanes.clear();
        letters.clear();
        cars.clear();
        positions.clear();
        speeds.clear();
        speed_factors.clear();
        // In a second of several steps a car may be gone again.
        const auto gone = Simulation::getArrivedIDList();
        for (const auto &car : Simulation::getDepartedIDList()) {
            if (std::find(gone.begin(), gone.end(), car) != gone.end()) {
                continue;
            }
            for (const auto &text : {car, Vehicle::getTypeID(car), Vehicle::getVehicleClass(car), Vehicle::getRouteID(car),
                                     edges_of(car)}) {
                letters += text;
                starts.push_back(static_cast<uint32_t>(letters.size()));
            }
            cars.push_back(identity(car));
            lanes.push_back(static_cast<uint32_t>(Vehicle::getLaneIndex(car)));
            positions.push_back(Vehicle::getLanePosition(car));
            speeds.push_back(Vehicle::getSpeed(car));
            speed_factors.push_back(Vehicle::getSpeedFactor(car));
        }
        *out = {cars.size(),   starts.data(),    letters.data(), cars.data(),
                lanes.data(), positions.data(), speeds.data(),  speed_factors.data()};
    });
}

int ds_read_departed(size_t *count, const uint64_t **out) {
    static std::vector<uint64_t> cars;
    return guarded([&] {
        cars.clear();
        for (const auto &car : Simulation::getDepartedIDList()) {
            cars.push_back(identity(car));
        }
        *count = cars.size();
        *out = cars.data();
    });
}

int ds_read_gone(size_t *count, const uint64_t **out) {
    static std::vector<uint64_t> cars;
    return guarded([&] {
        cars.clear();
        for (const auto &list : {Simulation::getArrivedIDList(), Simulation::getStartingTeleportIDList()}) {
            for (const auto &car : list) {
                cars.push_back(identity(car));
            }
        }
        *count = cars.size();
        *out = cars.data();
    });
}

int ds_read_route(const char *car, struct ds_route *route) {
    static std::string edges;
    return guarded([&] {
        edges = edges_of(car);
        *route = {edges.c_str(), static_cast<uint32_t>(Vehicle::getRouteIndex(car))};
    });
}

int ds_counts(struct ds_counts *counts) {
    return guarded([&] {
        counts->departed = static_cast<uint32_t>(Simulation::getDepartedNumber());
        // A car that Vehicle::remove takes off the road is listed as arrived until the next step.
        counts->arrived = static_cast<uint32_t>(Simulation::getArrivedNumber()) - removed;
        counts->pending = static_cast<uint32_t>(Simulation::getPendingVehicles().size());
        counts->teleports = static_cast<uint32_t>(Simulation::getStartingTeleportNumber());
        // A new collision lists both of its cars once. getCollisions would repeat it in every step while it lasts.
        counts->collisions = static_cast<uint32_t>(Simulation::getCollidingVehiclesNumber()) / 2;
        counts->emergency_stops = static_cast<uint32_t>(Simulation::getEmergencyStoppingVehiclesNumber());
    });
}

int ds_count_waiting(const uint32_t *areas, const uint32_t *crossings, size_t count, uint32_t *waiting) {
    constexpr double standing = 0.1; // SUMO's limit for cars that halt, in metres per second.
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            waiting[i] = 0;
            for (const auto &person : Edge::getLastStepPersonIDs(name(DS_EDGE, areas[i]))) {
                const bool stands = Person::getSpeed(person) < standing;
                waiting[i] += stands && Person::getNextEdge(person) == name(DS_EDGE, crossings[i]);
            }
        }
    });
}

int ds_read_losses(const char *const *cars, size_t count, double *losses) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            losses[i] = Vehicle::getTimeLoss(cars[i]);
        }
    });
}

int ds_read_stops(const char *const *cars, size_t count, uint8_t *stops) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            stops[i] = (Vehicle::getStopState(cars[i]) & 1) != 0;
        }
    });
}

int ds_read_co2(const uint32_t *lanes, size_t count, double *co2) {
    return guarded([&] {
        for (size_t i = 0; i < count; ++i) {
            co2[i] = Lane::getCO2Emission(name(DS_LANE, lanes[i]));
        }
    });
}

const char *ds_heard(void) { return Hush::ear.heard.c_str(); }

int ds_shortcuts(void) {
    return (reads_inner_lanes ? DS_LANES : 0) | (layout_of_generators != Layout::other ? DS_GENERATORS : 0) |
           ds_detours();
}

// In the order of shim.h.
const struct ds_shim functions = {
    _GLIBCXX_USE_CXX11_ABI,
    ds_load, ds_unload, ds_close, ds_register_names, ds_step, ds_time, ds_read_lanes, ds_read_lights, ds_set_lights, ds_set_programs,
    ds_insert, ds_enter, ds_place, ds_seed_generators, ds_clear_pending, ds_remove_cars, ds_read_departures,
    ds_read_departed, ds_read_gone, ds_read_route, ds_counts,
    ds_count_waiting, ds_read_losses, ds_read_stops, ds_read_co2, ds_heard, ds_shortcuts,
};

// Looks for SUMO's insides.
void find_inside(void *library) {
    cars_on.find(library);
    number_of.find(library);
    position_of.find(library);
    speed_of.find(library);
    reads_inner_lanes = lane_named.is_found() && cars_on.is_found() && number_of.is_found() && position_of.is_found() &&
                        speed_of.is_found();
    generators = static_cast<std::vector<Generator> *>(dlsym(library, "_ZN6MSLane6myRNGsE"));
    layout_of_generators = generators == nullptr ? Layout::other : Layout::unknown;
}

} // namespace

struct found DS_BIND(void *library) noexcept {
    static std::string missing, version;
    try {
        int count = 0;
        missing.clear();
        for (const Function *function = Function::all(); function != nullptr; function = function->next()) {
            if (!function->find(library) && function->is_needed()) {
                missing.append(count++ == 0 ? "" : " ").append(function->words());
            }
        }
        if (count == 0) {
            version = Simulation::getVersion().second;
        }
        return {&functions, version.c_str(), Simulation::getVersion.address(), missing.c_str(), count, find_inside};
    } catch (...) {
        return {&functions, "", nullptr, "", -1, find_inside};
    }
}
