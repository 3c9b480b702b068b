"""Names of this machine's C library and of the runtime that a board has not: a sketch may have its own.

A variable `write` of a sketch would else take the place of the function that the runtime calls, and a
function `index` would clash with the one in <string.h>.
"""

# POSIX, BSD and GNU. A name that avr-libc has too (`abs`, `exit`, `printf`) is no sketch's own there either.
_FILES = """
    access chdir chmod chown close creat dup dup2 fcntl fdopen fileno fsync ftruncate getcwd getdelim getline
    ioctl isatty link lockf lseek lstat mkdir mkfifo mkstemp mount open openat pclose pipe poll popen ppoll
    pread pwrite read readdir readlink readv remove rename rewind rmdir select stat statfs symlink sync
    syscall tempnam tmpfile tmpnam truncate ttyname umask umount unlink utime vfork write writev
"""
_PROCESSES = """
    alarm brk clone daemon environ execl execv execve fork getenv getopt getpgrp getpid getppid getuid kill
    killpg nice optarg optind pause prctl ptrace raise reboot sbrk setenv setsid setuid sigaction sigaltstack
    signal sigpause sigset sleep sysinfo system times ualarm uname usleep vhangup wait wait3 wait4 waitpid
"""
_NETWORK = "accept bind connect gethostbyname getsockopt listen recv recvfrom send sendto shutdown socket"
_TIME = """
    clock clock_gettime ctime ftime getitimer gettimeofday localtime nanosleep setitimer stime strftime time
    timegm timezone tzname
"""
_NUMBERS = """
    drand48 drem erand48 exp10 exp2 finite gamma j0 j1 jn lgamma logb nextafter pow10 rand_r remquo scalb
    scalbn significand signgam srandom tgamma y0 y1 yn
    erf erfc expm1 ilogb llrint llround log1p log2 nearbyint rint
"""
_TEXT = """
    asprintf basename bcmp bcopy bzero crypt dirname ffs fmemopen index rindex stpcpy strerror strfry
    strsignal swab versionsort
"""
_TYPES = """
    blkcnt_t blksize_t caddr_t clock_t clockid_t daddr_t dev_t fd_set gid_t id_t ino_t key_t loff_t mode_t
    nlink_t off_t pid_t quad_t register_t suseconds_t timer_t u_char u_int u_long u_quad_t u_short uid_t uint
    ulong useconds_t ushort
"""
# The runtime's own: Arduino's core has none of them.
_RUNTIME = """
    BlockEnd InterruptBlock SketchStart StatusRegister board board_wide eeprom_read eeprom_write sketch_start
"""
C_NAMES = frozenset(
    " ".join((_FILES, _PROCESSES, _NETWORK, _TIME, _NUMBERS, _TEXT, _TYPES, _RUNTIME)).split()
)
"""Names that a sketch may define."""
