"""A sketch made into C++: widths of numbers, prototypes, line numbers, loops that take time."""

import re
import time
from pathlib import Path

import pytest

from simmer_tui.sketch.preprocess import board_source, joined_source, own_c_names
from simmer_tui.sketch.prototypes import prototypes
from simmer_tui.sketch.switch_scopes import with_case_scopes


@pytest.mark.parametrize(
    ("written", "made"),
    [
        ("int x;", "int16_t x;"),
        ("unsigned int x;", "uint16_t x;"),
        ("unsigned x;", "uint16_t x;"),
        ("unsigned long x;", "uint32_t x;"),
        ("long int x;", "int32_t x;"),
        ("long long x;", "int64_t x;"),
        ("unsigned char x;", "unsigned char x;"),
        ("signed char x;", "signed char x;"),
        ("long double x;", "float x;"),
        ("double x = 1.0; // double", "float x = 1.0; // double"),
        ('print("int long");', 'print("int long");'),
        ("/* int */ short x;", "/* int */ int16_t x;"),
        ("x = 100000UL + 0xFFL;", "x = 100000U + 0xFF;"),
        ("int16_t pointer;", "int16_t pointer;"),
        ("sizeof(int)", "sizeof(int16_t)"),
        ("x = INT_MAX; y = ULONG_MAX;", "x = 32767; y = 4294967295U;"),
    ],
)
def test_numbers_have_the_widths_of_the_board(written: str, made: str) -> None:
    assert board_source(written) == made


@pytest.mark.parametrize(
    "loop",
    [
        *("while(1);", "while (true) ;", "for(;;);", "for ( ; ; ) {}", "while(1) { }", "do {} while (1);"),
        *("while (1) /* error */;", "for (;;) { // wait (\n }", "while (1) { ; }", "while ( !(on ) );"),
        *("for (; !on; );", "for (;!on;) {}", "while (true) continue;", "while (on) { continue; }"),
    ],
)
def test_an_empty_endless_loop_gets_a_statement(loop: str) -> None:
    made = board_source(f"void f() {{ {loop} }}")
    assert made.count("::yield()") == 1
    assert made.count("\n") == loop.count("\n")
    # It is a part of the condition: what follows the loop stays.
    assert made.endswith(f"{loop[loop.rindex(')') :]} }}")


@pytest.mark.parametrize(
    "text",
    [
        *('print("while(1);");', "// for (;;);\n", "while (1) { go(); }", "for (byte i = 0; i < 9; i++);"),
        *("while (char c = next());", "do { go(); } while_(1);"),
    ],
)
def test_other_loops_and_texts_stay(text: str) -> None:
    assert board_source(text) == text


def test_functions_have_prototypes_and_methods_have_none() -> None:
    source = (
        "struct P { int get() { return 1; } };\n"
        "void setup() { if (x) { y(); } }\n"
        "int add(int a, int b)\n{ return a; }\n"
        "void step(int by = 2) {}\n"
        "P make(const char *name) { return P(); }\n"
        "template <typename T>\nT least(T a, T b)\n{ return a; }\n"
        'extern "C" void irq(void) {}\n'
        "int known(int a);\nint known (int a) { return a; }\n"
    )
    made = prototypes(source)
    found, places = made.listed, made.places
    assert found == [
        *("void setup();", "int add(int a, int b);", "void step(int by = 2);", "P make(const char *name);"),
        *("template <typename T> T least(T a, T b);", 'extern "C" void irq(void);'),
    ]
    assert made.early == []
    (first,) = places
    assert source[first:].startswith("void setup()")


def test_a_default_of_a_function_stands_in_its_prototype_alone(tmp_path: Path) -> None:
    source = (
        "void setup() { say(); walk(1); }\n"
        'void say(const char *text = "a, (b)",\n         int times = 2) {}\n'
        "int ahead(int by = 1);\nint ahead(int by) { return by; }\n"
        "void walk(int a, int b=A0){}\n"
    )
    (tmp_path / "robot.ino").write_text(source, "utf-8")
    made = joined_source([tmp_path / "robot.ino"])
    assert 'void say(const char *text = "a, (b)",\n         int16_t times = 2);' in made
    assert "void walk(int16_t a, int16_t b=A0);" in made
    _, _, rest = made.rpartition("#line 1 ")
    assert re.search(r"void say\(const char \*text +,\n         int16_t times +\) \{\}", rest)
    assert re.search(r"void walk\(int16_t a, int16_t b +\)\{\}", rest)
    # One that the sketch has declared itself keeps its own.
    assert "int16_t ahead(int16_t by = 1);\nint16_t ahead(int16_t by) {" in rest


def test_a_default_of_what_is_defined_later_stays_where_it_is() -> None:
    source = (
        "const int FAST = 9;\nvoid setup() {}\n#define PAUSE 5\nconst int SLOW = 3;\n"
        "void a(int s = SLOW) {}\nvoid b(int t = PAUSE) {}\nvoid c(int f = FAST) {}\n"
    )
    assert prototypes(source).listed == ["void setup();", "void c(int f = FAST);"]


@pytest.mark.parametrize(
    ("written", "made"),
    [
        ("x = limit(x, 0, 255);", "x = limit(board_wide(x), board_wide(0), board_wide(255));"),
        ("limit(limit(a, 1, 2), b[c, d], -1)", None),
        ("// limit(a, b, c)", "// limit(a, b, c)"),
        ("swap(a, b); put(3, x); o.limit(1, 2);", "swap(a, b); put(3, x); o.limit(1, 2);"),
        ("limit<long>(a, 0, 9)", "limit<int32_t>(a, 0, 9)"),
        # A bit-field cannot be passed on.
        ("limit(c.b, c->b, 9)", "limit(c.b, c->b, board_wide(9))"),
    ],
)
def test_arguments_of_one_type_have_one_width(written: str, made: str | None) -> None:
    """On the board 3 has the type of an int variable."""
    template = (
        "template <typename T>\nT limit(T x, const T &low, T high) { return x; }\n"
        "template <class T> void swap(T &a, T &b) { T c = a; a = b; b = c; }\n"
        "template <class T> void put(int at, const T& value) {}\n"
    )
    if made is None:
        made = (
            "limit(board_wide(limit(board_wide(a), board_wide(1), board_wide(2))), board_wide(b[c, d]), "
            "board_wide(-1))"
        )
    assert board_source(template + written) == board_source(template) + made


def test_functions_in_a_branch_have_their_prototypes_in_it(tmp_path: Path) -> None:
    """The compiler skips branches: the prototypes stand before the next function too."""
    source = (
        "#if defined(ESP32) /* another\n board */\nvoid join(Network n) { }\n#elif A\n"
        "int speed() { }\n#endif\n"
        "void setup() { help(); }\n#ifdef B\n#ifndef C\nvoid last() {}\n#endif\n#endif\nvoid help() {}\n"
    )
    made = prototypes(source)
    found, places = made.listed, made.places
    assert found == [
        "#if defined(ESP32)\nvoid join(Network n);\n#endif",
        "#if defined(ESP32)\n#elif A\nint speed();\n#endif",
        "void setup();",
        "#ifdef B\n#ifndef C\nvoid last();\n#endif\n#endif",
        "void help();",
    ]
    begun = [source[place:].partition("(")[0] for place in places]
    assert begun == ["void join", "int speed", "void setup"]
    (tmp_path / "robot.ino").write_text(source, "utf-8")
    assert joined_source([tmp_path / "robot.ino"]).count("void help();") == 3


def test_files_are_joined_with_the_lines_of_each(tmp_path: Path) -> None:
    (tmp_path / "robot.ino").write_text("int a;\nvoid setup() {}\n", "utf-8")
    (tmp_path / "more.ino").write_text("void loop() { setup(); }\n", "utf-8")
    joined = joined_source([tmp_path / "robot.ino", tmp_path / "more.ino"])
    lines = joined.split("\n")
    assert lines[lines.index('#line 2 "robot.ino"') + 1] == "void setup() {}"
    assert lines[lines.index('#line 1 "more.ino"') + 1] == "void loop() { setup(); }"
    assert lines.index("void loop();") < lines.index('#line 2 "robot.ino"')


def test_long_sketches_are_read_in_a_moment() -> None:
    """Comments, tables and bodies of ten thousand lines: the time grows with their length."""
    lines = "/*" + "a b c\n" * 10_000 + "*/\nconst byte table[] = {" + "1, 2, 3,\n" * 10_000 + "};\n"
    begun = time.process_time()
    assert prototypes(f"int first = 1;\n{lines}void setup() {{}}\n{lines}").listed == ["void setup();"]
    assert time.process_time() - begun < 3.0


def test_a_function_after_an_attribute_keeps_the_words_before_it() -> None:
    source = (
        "static __attribute__((noinline)) void f() {}\n__attribute__((noinline)) void g() {}\nvoid h() {}\n"
    )
    assert prototypes(source).listed == ["static void f();", "void g();", "void h();"]


def test_a_name_of_the_c_library_may_be_a_variable_and_a_value_of_a_class() -> None:
    source = "struct Filter { int buf[4]; int index; void read(); };\nint index = 0;\nvoid read() {}\n"
    names = own_c_names([source])
    assert names == {"index", ".index"}
    made = board_source("f.index = index; p->index++; f.read(); read();", names)
    assert made == "f.index_of_sketch = index_of_sketch; p->index_of_sketch++; f.read(); read();"


def test_a_sketch_may_have_names_of_the_c_library() -> None:
    source = (
        "int signal = 5, time;\nfloat y0[3];\nvoid close(int angle) { grip.write(angle); read(); }\n"
        'enum { send };\nvoid f(int poll) { Serial.read(); arm->open(); print("close"); }\n'
        "class Arm { public: void open(); int pause; };\nvoid open() {}\n"
        "void g(int wait = clock) { sleep(1); }\n"
    )
    names = own_c_names([source, "extern int kill;\n"])
    # `open` is a member of a class too, and the rest is none of the sketch's.
    assert names == {"signal", "time", "y0", "close", "kill", "send"}
    assert own_c_names(["typedef unsigned long ulong;\nusing uint = unsigned int;\nbyte board[4][8];\n"]) == {
        *("ulong", "uint", "board")
    }
    made = board_source("close(time); Serial.close(); p -> time; // close\nx.signal = signal;", names)
    assert made == (
        "close_of_sketch(time_of_sketch); Serial.close(); p -> time; // close\nx.signal = signal_of_sketch;"
    )


@pytest.mark.parametrize(
    ("head", "made"),
    [
        ("void each(void (*cb)(int))", None),
        ("void ra(int (&a)[3])", None),
        ("void __attribute__((noinline)) at()", "void at()"),
        ("void at() __attribute__((noinline))", "void at()"),
        ("[[noreturn]] void halt()", "void halt()"),
        ("void IRAM_ATTR tick()", None),
        ("void say(char c = ')')", None),
        ("int most(int a, int b = max(3, 4))", None),
        ("struct Point make(int x)", None),
        ("template <typename T, class U> T mx(T a, U b)", None),
        ("std::vector<int> all()", None),
        ("const char *const *names(void)", "const char *const * names(void)"),
        ("static inline byte low(int a)", None),
        ("Arm::Arm(int pin) : pin(pin)", ""),
        ("void Arm::move(int to)", ""),
        ("Vec operator+(Vec a, Vec b)", ""),
        ("int table[] =", ""),
    ],
)
def test_heads_of_functions_have_the_prototypes_of_arduino(head: str, made: str | None) -> None:
    found = prototypes(f"int a = 5;\n{head} {{ x(1); if (a) {{ b(); }} }}\nvoid last() {{}}\n").listed
    expected = f"{head if made is None else made};"
    assert found == [*([expected] if made != "" else []), "void last();"]


def test_a_function_that_a_variable_uses_is_declared_before_it(tmp_path: Path) -> None:
    source = (
        "#include <TaskScheduler.h>\nclass Led { void on() { last(); } };\nint first = 1;\n"
        "Task t1(100, &blink);\nvoid (*steps[])(int) = { walk, turn };\n"
        "void setup() {}\nvoid blink() {}\nvoid walk(int a = 3) {}\nvoid turn(int a) {}\nvoid last() {}\n"
    )
    (tmp_path / "robot.ino").write_text(source, "utf-8")
    made = joined_source([tmp_path / "robot.ino"])
    before, _, rest = made.partition("Task t1")
    assert before.endswith('\nvoid blink();\n#line 4 "robot.ino"\n')
    assert "void last();" not in before
    before = rest.partition("void (*steps")[0]
    assert "void walk(int16_t a);" in before
    assert "void turn(int16_t a);" in before


@pytest.mark.parametrize(
    ("written", "made"),
    [
        (
            "switch (c) { case 'v': int v = f(); g(v); break; case ':': h(); }",
            "switch (c) { case 'v': { int v = f(); g(v); break; } case ':': h(); }",
        ),
        (
            "case A::B: default: const byte *p[2] = {x, y}; f(p); case 2: ;",
            "case A::B: default: { const byte *p[2] = {x, y}; f(p); } case 2: ;",
        ),
        ("case 1: long a(3), b; case 2: { int a = 1; } case 3: int z = 0;", None),
        ("case 1: int a; a = 3; case 2: g(a);", None),
        ("case 1: { int a = 3; } break; case 2: int b = 1; g(b);", None),
        ("case 1: int a = 3; case 2: a = 4;", None),
        # Refused on the board too.
        ('case 1: String s = "a"; f(s); case 2: ;', None),
        ("case 1: x = y ? 1 : 2; f(int(x)); case 2: ;", None),
    ],
)
def test_a_case_that_declares_a_variable_has_braces(written: str, made: str | None) -> None:
    if not written.startswith("switch"):
        written = f"void f() {{ switch (g(a)) {{ {written} }} }} int a = 3;"
        made = None if made is None else f"void f() {{ switch (g(a)) {{ {made} }} }} int a = 3;"
    assert with_case_scopes(written) == (written if made is None else made)


def test_a_switch_in_a_case_has_its_own_cases() -> None:
    written = "switch (a) { case 1: switch (b) { case 2: int c = 1; default: ; } int d = 2; case 3: ; }"
    made = with_case_scopes(written)
    assert made == (
        "switch (a) { case 1: { switch (b) { case 2: { int c = 1; } default: ; } int d = 2; } case 3: ; }"
    )
