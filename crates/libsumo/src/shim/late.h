// Functions of SUMO's library, found by name when it is opened. library.rs says why.
#ifndef SUMO_LATE_H
#define SUMO_LATE_H

#include <cstdlib>
#include <cstring>
#include <string>
#include <type_traits>
#include <typeinfo>
#include <utility>

#include <dlfcn.h>

namespace {

// Returns the parameters of a function as they stand in its symbol, from the name of its type. That of two texts is `FvRKSsS0_E`, and
// a function in two scopes has `RKSsS2_`. The type of the result is not in a symbol: headers.cpp compares it.
//
// Source: Itanium C++ ABI, 5.1 "Mangling". `S_`, `S0_` and so on repeat the first, the second and so on of the parts before. In a
// symbol the scopes of the function are the first parts; so these numbers grow by that many. Digits are lengths of names.
std::string parameters(const char *type, int scopes) {
    static const char digits[] = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"; // No function here has more parts.
    std::string made;
    const char *const end = type + std::strlen(type) - 1;
    for (const char *at = type + 2; at < end;) {
        char *rest = nullptr;
        const char *digit = nullptr;
        if (const auto length = std::strtoul(at, &rest, 10)) {
            made.append(at, static_cast<const char *>(rest) + length);
            at = rest + length;
        } else if (at[0] == 'S' && (at[1] == '_' || (digit = std::strchr(digits, at[1])) != nullptr)) {
            const auto part = digit == nullptr ? 0 : digit - digits + 1;
            made.append({'S', digits[part + scopes - 1], '_'});
            at += digit == nullptr ? 2 : 3;
        } else {
            made.push_back(*at++);
        }
    }
    return made;
}

// A static function of a class, whatever its type.
class Function {
public:
    // `space`: the namespace of the class, or empty: those of SUMO's insides have none. The types are those of functions without
    // a result.
    Function(const char *space, const char *owner, const char *name, const char *by_reference, const char *by_value)
        : space_(space), owner_(owner), name_(name), types_{by_reference, by_value}, next_(first) {
        first = this;
    }
    Function(const Function &) = delete;
    Function &operator=(const Function &) = delete;

    // Returns the last one that was declared, and the one before.
    static const Function *all() { return first; }
    const Function *next() const { return next_; }

    // Looks for the function, and returns whether the library has it. Texts may be passed by reference or by value: the
    // caller makes them, and passes their address, either way (the ABI's 3.1.2.3 "Non-Trivial Parameters"). SUMO 1.15 has
    // some by value, and reads them only.
    bool find(void *library) const {
        for (const char *type : types_) {
            for (const char *tag : tags) {
                address_ = dlsym(library, symbol(tag, type).c_str());
                if (address_ != nullptr) {
                    return true;
                }
            }
        }
        return false;
    }

    bool is_found() const { return address_ != nullptr; }
    // Returns whether it is of SUMO's interface, and not of its insides, without which the shim can do.
    bool is_needed() const { return *space_ != '\0'; }
    const void *address() const { return address_; }
    std::string words() const { return std::string(owner_) + "::" + name_; }

protected:
    mutable void *address_ = nullptr;

private:
    std::string symbol(const char *tag, const char *type) const {
        std::string scopes;
        int count = 0;
        for (const char *scope : {space_, owner_, name_}) {
            if (*scope != '\0') {
                scopes.append(std::to_string(std::strlen(scope))).append(scope);
                ++count;
            }
        }
        return "_ZN" + scopes + tag + "E" + parameters(type, count - 1);
    }

    // A function that returns a std::string of C++11 and takes none says so in its name. (GCC's manual, "C++ Attributes")
#if _GLIBCXX_USE_CXX11_ABI
    static constexpr const char *tags[] = {"", "B5cxx11"};
#else
    static constexpr const char *tags[] = {""};
#endif

    static const Function *first;

    const char *const space_, *const owner_, *const name_;
    const char *const types_[2];
    const Function *const next_;
};
const Function *Function::first = nullptr;

template <typename Type> class Late;

// A function of this type, called like any other, once it is found.
template <typename Result, typename... Parameters> class Late<Result(Parameters...)> : public Function {
public:
    Late(const char *space, const char *owner, const char *name)
        : Function(space, owner, name, typeid(void(Parameters...)).name(), typeid(void(std::decay_t<Parameters>...)).name()) {}

    Result operator()(Parameters... parameters) const {
        return reinterpret_cast<Result (*)(Parameters...)>(address_)(std::forward<Parameters>(parameters)...);
    }
};

} // namespace

#endif
