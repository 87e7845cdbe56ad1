// Compiles if the shim's declarations are those of the SUMO that is installed: bindings.rs.

#include "sumo.h"

#include <libsumo/libsumo.h>

// Whether a function is of a type, with texts by reference or by value: late.h finds both.
template <typename Theirs, typename Ours> constexpr bool fits = false;
template <typename Theirs, typename Result, typename... Parameters>
constexpr bool fits<Theirs, Result(Parameters...)> =
    std::is_same_v<Theirs, Result(Parameters...)> || std::is_same_v<Theirs, Result(std::decay_t<Parameters>...)>;

#define SUMO(OWNER, NAME, ...) static_assert(fits<decltype(libsumo::OWNER::NAME), __VA_ARGS__>, #OWNER "::" #NAME);
#include "sumo.inc"

static_assert(remove_vaporized == libsumo::REMOVE_VAPORIZED);
static_assert(move_automatic == libsumo::MOVE_AUTOMATIC);
static_assert(invalid_double == libsumo::INVALID_DOUBLE_VALUE);
