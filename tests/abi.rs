//! The binary interface: exported symbols, struct layouts and the library's name are what was agreed.
#![cfg(target_os = "linux")] // nm and readelf; the layouts are the same on every 64-bit target

mod support;

use std::fmt::Write as _;
use std::process::Command;

use support::{LIBRARY, assert_same_as_file, c_compiler, compile, library_dir, need, root, run, scratch};

#[test]
fn the_library_exports_the_agreed_symbols_and_nothing_else() {
    let Some(nm) = need(&["nm", "llvm-nm"]) else { return };
    let output = run(Command::new(nm).args(["-D", "--defined-only", "-P"]).arg(library_dir().join(LIBRARY)));
    let text = String::from_utf8_lossy(&output.stdout);
    let mut symbols: Vec<_> = text.lines().filter_map(|line| line.split_whitespace().next()).collect();
    symbols.sort_unstable();
    assert!(symbols.iter().all(|symbol| symbol.starts_with("plp_")), "foreign symbols: {symbols:?}");
    assert_same_as_file("tests/abi/symbols.txt", &(symbols.join("\n") + "\n"));
}

#[test]
fn the_library_knows_its_name() {
    let Some(readelf) = need(&["readelf", "llvm-readelf"]) else { return };
    let output = run(Command::new(readelf).arg("-d").arg(library_dir().join(LIBRARY)));
    let text = String::from_utf8_lossy(&output.stdout);
    let name = format!("[libpalpate.so.{}]", palpate::capi::version::PLP_ABI_VERSION);
    assert!(text.lines().any(|line| line.contains("SONAME") && line.contains(&name)), "{text}");
}

/// A field of a struct.
struct Field {
    name: String,
}

/// The structs of the header with their fields.
fn structs(header: &str) -> Vec<(String, Vec<Field>)> {
    let mut found = Vec::new();
    let mut fields = None;
    for line in header.lines() {
        if line == "typedef struct {" {
            fields = Some(Vec::new());
        } else if let Some(name) = line.strip_prefix("} ").and_then(|rest| rest.strip_suffix(';')) {
            if let Some(fields) = fields.take() {
                found.push((name.to_owned(), fields));
            }
        } else if let Some(fields) = &mut fields
            && let Some(declaration) = line.trim().strip_suffix(';')
        {
            let last = declaration.split([' ', '*']).next_back().unwrap_or_default();
            let name = last.split('[').next().unwrap_or_default().to_owned();
            fields.push(Field { name });
        }
    }
    found
}

#[test]
#[cfg(target_pointer_width = "64")]
fn structs_are_laid_out_as_agreed_and_have_no_hidden_padding() {
    let Some(compiler) = c_compiler() else { return };
    let header = std::fs::read_to_string(root().join("include/palpate/palpate.h")).expect("the header");
    let structs = structs(&header);
    assert!(structs.len() > 15, "only {} structs were found", structs.len());

    // A C program says what a C compiler makes of the header.
    let mut program =
        "#include <palpate/palpate.h>\n#include <stdio.h>\nint main(void) {\n    size_t sum;\n".to_owned();
    for (name, fields) in &structs {
        writeln!(program, "    sum = 0;\n    printf(\"{name} %zu\\n\", sizeof({name}));").unwrap();
        for Field { name: field } in fields {
            writeln!(
                program,
                "    sum += sizeof((({name} *)0)->{field});\n    \
                     printf(\"  {field} %zu\\n\", offsetof({name}, {field}));"
            )
            .unwrap();
        }
        writeln!(program, "    if (sum != sizeof({name})) {{ puts(\"{name} has padding\"); return 1; }}")
            .unwrap();
    }
    program.push_str("    return 0;\n}\n");

    let dir = scratch("layout");
    std::fs::write(dir.join("layout.c"), program).expect("the program can be written");
    let output = run(&mut Command::new(compile(compiler, &dir.join("layout.c"), &dir)));
    assert_same_as_file("tests/abi/layout.txt", &String::from_utf8_lossy(&output.stdout));
}
