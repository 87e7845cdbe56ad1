// What the shim calls of SUMO's insides, and does without where it is absent. shortcuts.rs says why, and what is checked.
#ifndef SUMO_INSIDE_H
#define SUMO_INSIDE_H

#include "late.h"
#include "sumo.h"

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <dlfcn.h>

namespace {

// Functions of SUMO's class of lanes. libsumo's interface has nothing that seeds the generators of some lanes in the middle of a
// simulation. SUMO 1.15 to 1.28 export them.
const Late<void(int index, Text state)> load_generator("", "MSLane", "loadRNGState");
const Late<const void *(Text lane)> lane_named("", "MSLane", "dictionary");

// A constant method of SUMO without parameters. Its symbol has the class as its one scope.
template <typename Result> class Method {
public:
    explicit Method(const char *symbol) : symbol_(symbol) {}
    void find(void *library) const { address_ = dlsym(library, symbol_); }
    bool is_found() const { return address_ != nullptr; }
    Result operator()(const void *object) const { return reinterpret_cast<Result (*)(const void *)>(address_)(object); }

private:
    const char *const symbol_;
    mutable void *address_ = nullptr;
};

const Method<const std::vector<const void *> &> cars_on("_ZNK6MSLane17getVehiclesSecureEv");
const Method<long long> number_of("_ZNK13MSBaseVehicle14getNumericalIDEv");
const Method<double> position_of("_ZNK9MSVehicle17getPositionOnLaneEv");
const Method<double> speed_of("_ZNK9MSVehicle8getSpeedEv");

// SUMO's generator of random numbers, in a vector of them. `count`: numbers drawn so far.
struct Generator {
    std::mt19937 engine;
    unsigned long long count;
    std::string id;
};
std::vector<Generator> *generators = nullptr;

// Numbers that cars have here, by SUMO's own. One that another has pushed out is asked for again.
class Identities {
public:
    const uint64_t *of(long long number) const {
        const auto &place = places_[static_cast<size_t>(number) % size];
        return place.number == number ? &place.identity : nullptr;
    }
    void keep(long long number, uint64_t identity) { places_[static_cast<size_t>(number) % size] = {number, identity}; }
    void clear() { places_.assign(size, {-1, 0}); }

private:
    static constexpr size_t size = 1 << 16; // Cars are numbered one after the other: few of so many collide.
    struct Place {
        long long number;
        uint64_t identity;
    };
    std::vector<Place> places_;
};

} // namespace

#endif
