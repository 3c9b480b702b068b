// After the core and before a sketch's own files: from here on structs have no gaps, as on an AVR, which has no
// alignment. Other headers that a sketch includes are compiled without it (see struct_layout.py).
#pragma pack(1)
