// Says what was simulated when SUMO dies or never comes back. Why so: src/guard.rs.
//
// Whatever the handler of a signal reads is in static memory, and all that it calls is allowed in a handler.

#include "shim.h"

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <thread>

#include <pthread.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

namespace {

constexpr int SIGNALS[] = {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL};
constexpr size_t COUNT = sizeof SIGNALS / sizeof *SIGNALS;
struct sigaction before[COUNT];

// What is simulated, and what to do if it dies.
char name[1024], way_out[1024];
// Odd while a thread is inside SUMO. Each way in and out adds one.
std::atomic<uint64_t> crossings{0};
std::atomic<int> call{DS_OTHER};
std::atomic<int> thread_inside{0};
std::atomic<clockid_t> clock_inside{};
std::atomic<uint64_t> second{0};
std::atomic<uint64_t> load_limit_s{600}, step_limit_s{120}, memory_limit_mib{8192};

static_assert(std::atomic<uint64_t>::is_always_lock_free && std::atomic<int>::is_always_lock_free, "a handler reads them");

// A line in memory of its own.
struct Line {
    char letters[2048];
    size_t length = 0;

    Line &operator<<(const char *text) {
        while (*text != '\0' && length < sizeof letters) {
            letters[length++] = *text++;
        }
        return *this;
    }

    Line &operator<<(uint64_t number) {
        char digits[21];
        char *begin = digits + sizeof digits - 1;
        *begin = '\0';
        do {
            *--begin = static_cast<char>('0' + number % 10);
            number /= 10;
        } while (number > 0);
        return *this << begin;
    }

    void print() const {
        const char *rest = letters;
        for (size_t left = length; left > 0;) {
            const ssize_t written = write(STDERR_FILENO, rest, left);
            if (written <= 0) {
                return;
            }
            rest += written;
            left -= static_cast<size_t>(written);
        }
    }
};

Line &operator<<(Line &line, const std::atomic<int> &what) {
    switch (what.load()) {
    case DS_LOADING:
        return line << "while it loaded";
    case DS_STEPPING:
        return line << "at second " << second.load() << " of an episode";
    default:
        return line << "between two steps, at second " << second.load() << " of an episode";
    }
}

void show_way_out(Line &line) { line << (*way_out == '\0' ? "" : "\n  way out: ") << way_out << "\n"; }

int own_thread() { return static_cast<int>(syscall(SYS_gettid)); }

void die(int number, siginfo_t *about, void *) {
    const int kept = errno;
    if (crossings.load() % 2 == 1 && own_thread() == thread_inside.load()) {
        Line line;
        line << "error: " << name << (*name == '\0' ? "" : ": ") << "SUMO died " << call << ", of signal "
             << static_cast<uint64_t>(number) << "; its last words, if it had some, are above";
        show_way_out(line);
        line.print();
    }
    // The action of before is taken next: a fault comes again by itself, and a signal that somebody sent is sent again.
    for (size_t i = 0; i < COUNT; ++i) {
        if (SIGNALS[i] == number) {
            sigaction(number, &before[i], nullptr);
        }
    }
    if (about->si_code <= 0) {
        raise(number);
    }
    errno = kept;
}

uint64_t cpu_s(clockid_t clock) {
    struct timespec time;
    return clock_gettime(clock, &time) == 0 ? static_cast<uint64_t>(time.tv_sec) : 0;
}

// Memory of this process that is in RAM.
uint64_t memory_mib() {
    unsigned long all = 0, resident = 0;
    if (FILE *const file = std::fopen("/proc/self/statm", "re")) {
        if (std::fscanf(file, "%lu %lu", &all, &resident) != 2) {
            resident = 0;
        }
        std::fclose(file);
    }
    return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE)) >> 20;
}

[[noreturn]] void give_up(Line &line) {
    show_way_out(line);
    line.print();
    // Not exit(): destructors would wait for the thread that is inside.
    _exit(1);
}

// Looks once a second whether SUMO is still in the same call, and what that has cost.
void watch() {
    uint64_t seen = 0, begun_s = 0, begun_mib = 0;
    for (;;) {
        const struct timespec pause = {1, 0};
        nanosleep(&pause, nullptr);
        const uint64_t now = crossings.load();
        if (now % 2 == 0) {
            continue;
        }
        const uint64_t spent_s = cpu_s(clock_inside.load()), used_mib = memory_mib();
        if (now != seen) {
            seen = now;
            begun_s = spent_s;
            begun_mib = used_mib;
            continue;
        }
        const uint64_t most_s = call.load() == DS_LOADING ? load_limit_s.load() : step_limit_s.load();
        const bool is_too_long = spent_s > begun_s + most_s, is_too_large = used_mib > begun_mib + memory_limit_mib.load();
        Line line;
        line << "error: " << name << (*name == '\0' ? "" : ": ");
        if (now != crossings.load()) {
            continue; // It came back in the meantime.
        }
        if (is_too_long) {
            line << "SUMO did not come back " << call << ": it has computed for " << most_s << " s";
            give_up(line);
        }
        if (is_too_large) {
            line << "SUMO took " << memory_limit_mib.load() << " MiB more memory in one call, " << call;
            give_up(line);
        }
    }
}

} // namespace

void ds_guard(void) {
    struct sigaction action = {};
    action.sa_sigaction = die;
    // On the stack for signals: that of the thread may be used up.
    action.sa_flags = SA_SIGINFO | SA_ONSTACK;
    sigemptyset(&action.sa_mask);
    for (size_t i = 0; i < COUNT; ++i) {
        sigaction(SIGNALS[i], &action, &before[i]);
    }
    // Signals of the process are for its other threads.
    sigset_t all, kept;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &kept);
    try {
        std::thread(watch).detach();
    } catch (...) {
        // Without the thread nobody watches. A simulation does not need it.
    }
    pthread_sigmask(SIG_SETMASK, &kept, nullptr);
}

void ds_name(const char *what, const char *do_what) {
    std::strncpy(name, what, sizeof name - 1);
    std::strncpy(way_out, do_what, sizeof way_out - 1);
}

void ds_limit(uint64_t load_s, uint64_t step_s, uint64_t memory) {
    load_limit_s = load_s;
    step_limit_s = step_s;
    memory_limit_mib = memory;
}

void ds_enter(enum ds_call what, uint64_t at_second) {
    thread_local const int own = own_thread();
    thread_local clockid_t clock = [] {
        clockid_t found = CLOCK_PROCESS_CPUTIME_ID;
        pthread_getcpuclockid(pthread_self(), &found);
        return found;
    }();
    thread_inside = own;
    clock_inside = clock;
    call = what;
    second = at_second;
    ++crossings;
}

void ds_leave(void) { ++crossings; }
