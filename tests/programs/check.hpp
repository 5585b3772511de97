// What the C++ programs here check: the line of a condition that does not hold, and exit code 1.
#include <cstdlib>
#include <iostream>

inline void check(bool condition, int line)
{
    if (!condition) {
        std::cerr << "line " << line << '\n';
        std::exit(1);
    }
}
#define CHECK(condition) check(condition, __LINE__)
