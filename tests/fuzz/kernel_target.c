/* Calls the kernel with hostile arrays that are drawn from the bytes of an input: a target of libFuzzer.
 *
 * ABOUT says which functions (hostile_kernel.c). With REPLAYS it is a program of its own, which takes that number and
 * files to play. Built with sanitizers, which end the program at the first fault.
 */
#define DRAWN_FROM_BYTES
#include "hostile_kernel.c"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#ifndef REPLAYS
int LLVMFuzzerInitialize(int *count, char ***arguments);

int LLVMFuzzerInitialize(int *count, char ***arguments) {
    (void)count, (void)arguments;
    about = ABOUT;
    return 0;
}
#endif

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    int64_t calls[16] = {0}, outcomes[4] = {0};
    bytes = data, bytes_left = size, state = 88172645463325252u + size;
    play(calls, outcomes);
    return 0;
}

#ifdef REPLAYS
int main(int count, char **files) {
    about = count > 1 ? atoi(files[1]) : 0;
    for (int i = 2; i < count; i++) {
        static uint8_t data[1 << 16];
        FILE *file = fopen(files[i], "rb");
        if (!file) return 2;
        fprintf(stderr, "%s\n", files[i]);
        size_t size = fread(data, 1, sizeof data, file);
        fclose(file);
        LLVMFuzzerTestOneInput(data, size);
    }
    return 0;
}
#endif
