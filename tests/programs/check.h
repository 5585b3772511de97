/* Checks of the test programs. */
#include <isotherm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                                        \
    do {                                                                                        \
        if (!(condition)) {                                                                     \
            fprintf(stderr, "line %d: %s; \"%s\"\n", __LINE__, #condition, isotherm_error_message()); \
            exit(1);                                                                            \
        }                                                                                       \
    } while (0)
/* Checks the returned code, and that the error message contains the word. */
#define GIVES(call, expected, word) CHECK((call) == (expected) && strstr(isotherm_error_message(), (word)) != NULL)
