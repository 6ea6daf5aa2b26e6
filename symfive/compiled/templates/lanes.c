#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX2__)
#define LANES 4
#elif defined(__SSE2__) || defined(__aarch64__) || defined(__VSX__)
#define LANES 2
#else
#define LANES 1
#endif
