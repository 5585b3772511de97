/*
 * Locks memory in threads with stacks of several sizes: stacks. Prints the code of each call, the main thread's first.
 * The process lives on, whether it may lock memory or not.
 */
#define _GNU_SOURCE
#include <isotherm.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

static void *lock_memory(void *code)
{
    *(isotherm_code *)code = isotherm_realtime(-1, 0, true, 0);
    return NULL;
}

int main(void)
{
    /* The last ones are less and more than is touched of a stack; 0 is an ordinary thread. */
    const size_t sizes[] = {0, 64 << 10, 96 << 10, 4 << 20};
    isotherm_code code;
    lock_memory(&code);
    printf("%d\n", (int)code);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        pthread_t thread;
        pthread_attr_t attributes;
        if (pthread_attr_init(&attributes) != 0
            || (sizes[i] != 0 && pthread_attr_setstacksize(&attributes, sizes[i]) != 0)
            || pthread_create(&thread, &attributes, lock_memory, &code) != 0 || pthread_join(thread, NULL) != 0)
            return 1;
        printf("%d\n", (int)code);
        pthread_attr_destroy(&attributes);
    }
    return 0;
}
