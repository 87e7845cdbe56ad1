/* The few calls of SUMO that this crate needs, in plain C; `bindgen` reads this file. `ds_` is the shim's own prefix.
 *
 * Every function that returns an int returns 0, or another number with a text in ds_last_error(). No exception leaves. Arrays
 * that a function returns belong to the shim and are valid until the next call. */
#ifndef SUMO_SHIM_H
#define SUMO_SHIM_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum ds_shortcut { DS_DEVICES = 1, DS_GENERATORS = 2, DS_LANES = 4, DS_TEXTS = 8 };

enum ds_kind { DS_LANE, DS_LIGHT, DS_ROUTE, DS_TYPE, DS_EDGE };

/* The cars of the i-th lane of the call are starts[i] .. starts[i + 1] in the other arrays. */
struct ds_cars {
    const uint32_t *starts;
    const uint64_t *cars;
    const double *positions;
    const double *speeds;
};

/* The state of the i-th light of the call is starts[i] .. starts[i + 1] in letters. */
struct ds_states {
    const uint32_t *starts;
    const char *letters;
};

struct ds_insertion {
    uint64_t car;
    double position;
    double speed; /* Negative: "max". */
    uint32_t route;
};

/* A car of any type, on any lane. */
struct ds_entering {
    uint64_t car;
    double position;
    double speed;        /* Negative: "max". */
    double speed_factor; /* Desired speed as a share of the limit. */
    double end;          /* Position on the route's last edge at which it has arrived. Negative: "max". */
    uint32_t route;
    uint32_t type;
    uint32_t lane; /* Index on the route's first edge. UINT32_MAX: the first one that it may use. */
};

/* The place and speed that a car gets. */
struct ds_placing {
    uint64_t car;
    double position;
    double speed;
    uint32_t lane;
};

/* The cars that entered in the last step. The five texts of car i are starts[5 * i] .. starts[5 * i + 5] in letters:
 * its name, its type, its class, its route, and the edges of the route with \x1f between. Numbers are those after the
 * step. */
struct ds_departures {
    size_t count;
    const uint32_t *starts;
    const char *letters;
    const uint64_t *cars;
    const uint32_t *lanes; /* Index on the edge. */
    const double *positions;
    const double *speeds;
    const double *speed_factors;
};

/* The route of a car that has entered, as it is now: its edges with \x1f between, and the index of the edge on which the
 * car is. In a junction it is that of the edge before. */
struct ds_route {
    const char *edges;
    uint32_t at;
};

struct ds_counts {
    uint32_t departed;
    uint32_t arrived;
    uint32_t pending;
    uint32_t teleports;
    uint32_t collisions;
    uint32_t emergency_stops;
};

/* The calls of a library that is open. Nothing reaches the terminal. One thread may be inside at a time, because there is one
 * simulation per process. Lanes, lights, routes and types are registered once by name and are passed as indices. */
struct ds_shim {
    /* Whether the library's std::string is that of C++11, and not the older one. */
    int strings_of_cpp11;
    /* Loads, or loads again in place. Also fails if a registered name is unknown to the new net. */
    int (*load)(const char *const *options, size_t count);
    /* Ends the simulation, and keeps all registered names for the next load. */
    int (*unload)(void);
    /* Ends the simulation and forgets all registered names. */
    int (*close)(void);
    /* Registers all or none: names[i] becomes index *first + i of its kind. If nothing is loaded, the next load looks them up. */
    int (*register_names)(enum ds_kind kind, const char *const *names, size_t count, uint32_t *first);
    /* One step, or as many as there are until this second; 0 is one. */
    int (*step)(double until);
    int (*time)(double *seconds);
    int (*read_lanes)(const uint32_t *lanes, size_t count, struct ds_cars *cars);
    int (*read_lights)(const uint32_t *lights, size_t count, struct ds_states *states);
    int (*set_lights)(const uint32_t *lights, size_t count, const struct ds_states *states);
    int (*set_programs)(const uint32_t *lights, size_t count, const char *program);
    int (*insert)(const struct ds_insertion *cars, size_t count);
    int (*enter)(const struct ds_entering *cars, size_t count);
    /* Puts cars that were added at their places on their routes at once, whoever is there. */
    int (*place)(const struct ds_placing *cars, size_t count);
    /* Seeds the random generators number first, first + 1 and so on with seeds[0], seeds[1] and so on. With the option
     * --thread-rngs of at least the number of lanes, generator n is that of the lane that SUMO has loaded as number n.
     * `counted`: whether the text of a generator's state begins with the number of draws. */
    int (*seed_generators)(uint32_t first, const uint32_t *seeds, size_t count, int counted);
    int (*clear_pending)(void);
    int (*remove_cars)(const uint32_t *lanes, size_t count);
    int (*read_departures)(struct ds_departures *departures);
    /* Only the numbers of these cars. */
    int (*read_departed)(size_t *count, const uint64_t **cars);
    /* The numbers of the cars that ended their trip or began to teleport in the last step. */
    int (*read_gone)(size_t *count, const uint64_t **cars);
    int (*read_route)(const char *car, struct ds_route *route);
    int (*counts)(struct ds_counts *counts);
    /* waiting[i]: how many persons stand on the edge areas[i] and go to the edge crossings[i] next. */
    int (*count_waiting)(const uint32_t *areas, const uint32_t *crossings, size_t count, uint32_t *waiting);
    /* losses[i]: seconds that a car on the road has lost so far, as its trip counts them. */
    int (*read_losses)(const char *const *cars, size_t count, double *losses);
    /* stops[i]: whether a car on the road makes a stop of its plan now, such as a bus at its stop. */
    int (*read_stops)(const char *const *cars, size_t count, uint8_t *stops);
    /* co2[i]: mass of CO2 that the cars on a lane emit, in mg/s, in the last step. */
    int (*read_co2)(const uint32_t *lanes, size_t count, double *co2);
    /* What SUMO wrote to the terminal in the last call. Valid until the next one. */
    const char *(*heard)(void);
    /* The shortcuts that are taken: bits of ds_shortcut. */
    int (*shortcuts)(void);
};

/* Opens libsumo from a file, or from where the system looks if the name has no slash. Returns 1 if it cannot be loaded; 2 if it
 * lacks functions, whose names are then the text, with blanks between. Must succeed once at most. Nothing closes it.
 * `version`: SUMO's, such as "SUMO 1.15.0". `file`: the library's. */
int ds_open(const char *library, const struct ds_shim **shim, const char **version, const char **file);

/* Goes past SUMO's interface from now on, where that saves time. Once, after ds_open(). */
void ds_take_shortcuts(void);

/* Lets cars that are made from now on have few devices: those for trips and routes that SUMO's options ask for. 0: all that SUMO
 * may give them. Without that shortcut it changes nothing. */
void ds_few_devices(int few);

/* What a thread asks SUMO for. */
enum ds_call { DS_OTHER, DS_LOADING, DS_STEPPING };

/* From now on, the death of SUMO and a call without an end are errors in words on standard error. Once per process. */
void ds_guard(void);

/* Says what is simulated, and what to do if that ends the process. Longer texts than 1023 bytes are cut. */
void ds_name(const char *what, const char *way_out);

/* Limits a call: CPU seconds of a load, of another call, and how many MiB of memory each may take. */
void ds_limit(uint64_t load_s, uint64_t step_s, uint64_t memory_mib);

/* A thread goes into SUMO, in this second of an episode, and comes back. One at a time. */
void ds_enter(enum ds_call call, uint64_t second);
void ds_leave(void);

/* Loads a shared library from memory. */
int ds_open_bytes(const void *bytes, size_t size);

/* Returns why the last call of this thread failed. */
const char *ds_last_error(void);

/* Returns the file of the program or library that this code is in; empty if nobody knows. */
const char *ds_own_file(void);

/* Returns the version of the loaded GNU C library with its libm, such as "2.36"; empty for another one. */
const char *ds_c_library(void);

#ifdef __cplusplus
}
#endif

#endif
