// Marks of an AVR's heap, for sketches that look at them: the heap is empty. Free memory is a constant (see preprocess.py).
#if !defined(SIMMER_ESP32)
extern "C" {
short __heap_start, __bss_end;
short* __brkval = nullptr;
char* __malloc_heap_start = nullptr;
}
#endif
