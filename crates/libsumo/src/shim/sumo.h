// SUMO's functions, as objects that are called like them.
#ifndef SUMO_SUMO_H
#define SUMO_SUMO_H

#include "late.h"

#include <string>
#include <utility>
#include <vector>

namespace {

using Text = const std::string &;
using Texts = std::vector<std::string>;

#define SUMO(OWNER, NAME, ...)                                                                                                   \
    namespace OWNER {                                                                                                            \
    const Late<__VA_ARGS__> NAME("libsumo", #OWNER, #NAME);                                                                      \
    }
#include "sumo.inc"
#undef SUMO

// SUMO's constants and defaults: TraCIConstants.h, and the declarations in Simulation.h and Vehicle.h.
constexpr char remove_vaporized = 3;
constexpr int move_automatic = 0;
constexpr double invalid_double = -1073741824.0;

} // namespace

#endif
