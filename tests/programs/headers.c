/*
 * Only the headers, for compilers with more warnings. It is valid C and C++.
 */
#ifdef __cplusplus
#include <isotherm.hpp>
#else
#include <isotherm.h>
#endif

int main(void)
{
    isotherm_raw_sample sample = ISOTHERM_RAW_SAMPLE_INIT;
    return sample.session != 0;
}
