//! Whatever is found in the place of a CUDA driver, and whatever it does: a status with the reason, and the processor serves.
//!
//! Each case is a run of `tests/c/backends.c` that finds a driver of its own: `tests/c/fake_driver.c`, or what else lies there.
#![cfg(target_os = "linux")] // the driver's file name, and LD_LIBRARY_PATH

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use support::{c_compiler, compile, root, run, scratch};

/// The program, compiled once.
fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let compiler = c_compiler().expect("asked for before");
        compile(compiler, &root().join("tests/c/backends.c"), &scratch("drivers"))
    })
}

/// What the program says with a driver in `dir`. It ends well and gives all back, or the test fails.
fn said_with(dir: &Path, fault: &str) -> String {
    let output =
        run(Command::new(program()).current_dir(dir).env("LD_LIBRARY_PATH", dir).env("FAKE_FAULT", fault));
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(
        said.ends_with("backends: ok\n") && said.contains("\ncpu: cpu, device -1, CPU, 1 thread; \n"),
        "{said}"
    );
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    said
}

/// A folder with a fake driver made with `defines`; `None` where there is no C compiler.
fn fake_driver(case: &str, defines: &[&str]) -> Option<PathBuf> {
    let dir = scratch(&format!("driver_{case}"));
    fake_library("fake_driver.c", defines, &dir.join("libcuda.so.1"))?;
    Some(dir)
}

/// Makes a library of a source in `tests/c`; `None` where there is no C compiler.
fn fake_library(source: &str, defines: &[&str], to: &Path) -> Option<()> {
    run(Command::new(c_compiler()?)
        .args(["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"])
        .args(defines)
        .arg(root().join("tests/c").join(source))
        .arg("-o")
        .arg(to));
    Some(())
}

/// What the program says with a fake driver made with `defines`.
fn said(case: &str, defines: &[&str], fault: &str) -> Option<String> {
    Some(said_with(&fake_driver(case, defines)?, fault))
}

/// That no GPU is found for a reason, that asking for one tells it, and that the processor is taken for it.
fn assert_no_gpu(said: &str, reason: &str) {
    for line in [
        format!("gpus: 0; no GPU: {reason}\n"),
        format!("cuda: PLP_ERR_NO_DEVICE: no GPU: {reason}\n"),
        format!("auto: cpu, device -1, CPU, 1 thread; no GPU: {reason}\n"),
    ] {
        assert!(said.contains(&line), "not said: {line}{said}");
    }
}

/// That a simulation on the GPU cannot be created, with a status and a reason, and that the processor is taken for it.
fn assert_refused(said: &str, status: &str, reason: &str) {
    for line in
        [format!("cuda: {status}: {reason}\n"), format!("auto: cpu, device -1, CPU, 1 thread; {reason}\n")]
    {
        assert!(said.contains(&line), "not said: {line}{said}");
    }
}

#[test]
fn a_gpu_that_works_is_taken() {
    let Some(said) = said("sound", &["-DGPUS=2"], "") else { return };
    assert!(
        said.starts_with("gpus: 2; \ngpu 0: Fake 0, 9.0, 8589934592 bytes, supported 1\ngpu 1: "),
        "{said}"
    );
    for backend in ["cuda", "auto"] {
        assert!(said.contains(&format!("\n{backend}: gpu, device 0, Fake 0; \n")), "{said}");
    }
    assert!(!said.contains("step"), "{said}");
}

#[test]
fn statistics_hold_the_devices_time_and_every_byte_that_the_driver_copied() {
    let Some(said) = said("counted", &[], "") else { return };
    let after = |start: &str| {
        let lines = said.lines().filter_map(|line| line.strip_prefix(start));
        lines.filter(|rest| rest.contains(" bytes to ")).map(str::to_owned).collect::<Vec<_>>()
    };
    let copied = ["cuda: ", "auto: "].map(|backend| after(backend).concat());
    assert_eq!(after("driver: "), copied, "{said}");
    // The model went there, and a surface came back.
    assert!(!copied[0].starts_with("0 bytes") && !copied[0].ends_with(" 0 to the host"), "{said}");
    assert!(said.contains("\ncpu: 0 bytes to the device, 0 to the host\n"), "{said}");
    for backend in ["cuda", "auto"] {
        assert!(said.contains(&format!("\n{backend}: 0.000250 s on the device\n")), "{said}");
    }
}

#[test]
#[cfg(feature = "nvtx")]
fn profilers_see_steps_and_what_the_host_waits_for_in_them() {
    for library in ["libnvtx3interop.so.1", "libnvToolsExt.so.1"] {
        let Some(dir) = fake_driver("profiled", &[]) else { return };
        fake_library("fake_nvtx.c", &[], &dir.join(library)).expect("compiled before");
        let said = said_with(&dir, "");
        let (mut open, mut seen) = (Vec::new(), std::collections::BTreeSet::new());
        for line in said.lines().filter_map(|line| line.strip_prefix("nvtx: ")) {
            if let Some((depth, name)) = line.split_once(' ') {
                assert_eq!(depth, open.len().to_string(), "{said}");
                open.push(name);
                seen.insert(open.join(" > "));
            } else {
                open.pop();
                assert_eq!(line, open.len().to_string(), "{said}");
            }
        }
        assert!(open.is_empty(), "{open:?}");
        // A simulation is prepared by steps of its own.
        let expected = ["launch", "publish", "step", "step > launch", "step > wait", "wait"];
        assert!(seen.iter().eq(&expected), "{seen:?}");
        std::fs::remove_dir_all(&dir).expect("the test's own folder");
    }
}

#[test]
fn a_driver_without_a_gpu_says_so() {
    let reason = "the CUDA driver finds no GPU";
    for (case, defines, fault) in [
        ("count", &["-DGPUS=0"][..], ""),
        ("init", &[], "cuInit 100 0"),
        ("count_fails", &[], "cuDeviceGetCount 100 0"),
    ] {
        let Some(said) = said(&format!("none_{case}"), defines, fault) else { return };
        assert_no_gpu(&said, reason);
    }
}

#[test]
fn an_old_gpu_is_listed_and_not_used() {
    let Some(said) = said("old", &["-DMAJOR=6"], "") else { return };
    assert!(said.contains("gpu 0: Fake 0, 6.0, 8589934592 bytes, supported 0\n"), "{said}");
    let reason = "no GPU: Fake 0 has compute capability 6.0; the kernels need 7.5";
    assert_refused(&said, "PLP_ERR_NO_DEVICE", reason);
}

#[test]
fn a_driver_that_does_not_start_says_why() {
    let Some(named) = said("init_named", &[], "cuInit 999 0") else { return };
    assert_no_gpu(&named, "the CUDA driver does not start: CUDA_ERROR_UNKNOWN (999)");
    let Some(unknown) = said("init_unknown", &[], "cuInit 4711 0") else { return };
    assert_no_gpu(&unknown, "the CUDA driver does not start: status 4711");
    let Some(stub) = said("stub", &[], "cuInit 34 0") else { return };
    assert_no_gpu(&stub, "the CUDA driver is only the stub that programs are linked against");
}

#[test]
fn a_driver_without_a_function_names_it() {
    let Some(said) = said("missing", &["-DWITHOUT_STREAM_QUERY"], "") else { return };
    assert_no_gpu(&said, "the CUDA driver has no function cuStreamQuery");
}

#[test]
fn a_file_that_is_no_library_is_told_by_the_loaders_words() {
    if c_compiler().is_none() {
        return;
    }
    for (case, bytes) in [("garbage", &[b'x'; 4096][..]), ("short", b"\x7fELF"), ("empty", b"")] {
        let dir = scratch(&format!("driver_{case}"));
        let file = dir.join("libcuda.so.1");
        std::fs::write(&file, bytes).expect("the file can be written");
        let said = said_with(&dir, "");
        let line = said.lines().next().expect("a line");
        let start = format!("gpus: 0; no GPU: no CUDA driver can be loaded: {}: ", file.display());
        assert!(line.len() > start.len() && line.starts_with(&start), "{line}");
        assert_no_gpu(&said, line.strip_prefix("gpus: 0; no GPU: ").expect("as just seen"));
    }
}

#[test]
fn a_gpu_without_memory_is_a_limit() {
    for (case, fault, what) in [
        ("device", "cuMemAlloc_v2 2 5", " bytes on the GPU"),
        ("host", "cuMemHostAlloc 2 1", "memory that the GPU sees"),
        ("kernels", "cuModuleLoadData 2 2", "loading the kernels on Fake 0"),
        ("context", "cuDevicePrimaryCtxRetain 2 0", "a context on the GPU"),
    ] {
        let Some(said) = said(&format!("memory_{case}"), &[], fault) else { return };
        let line = said.lines().find(|line| line.starts_with("cuda: ")).expect("an answer");
        let why = line.strip_prefix("cuda: PLP_ERR_LIMIT: ").unwrap_or_else(|| panic!("{said}"));
        assert!(why.ends_with(&format!("{what}: the GPU has too little free memory")), "{why}");
    }
}

#[test]
fn a_failure_while_a_simulation_is_created_is_told_and_undone() {
    for (case, fault, reason) in [
        ("kernels", "cuModuleLoadData 222 0", "loading the kernels on Fake 0: status 222"),
        ("kernel", "cuModuleGetFunction 500 3", "finding the kernel cut_single: status 500"),
        ("shared", "cuFuncSetAttribute 1 0", "dividing a processor's memory: status 1"),
        ("attribute", "cuFuncGetAttribute 1 0", "asking about a kernel: status 1"),
        ("capture", "cuStreamEndCapture 901 0", "recording a step: status 901"),
        ("graph", "cuGraphInstantiateWithFlags 801 0", "preparing a step: status 801"),
        ("first", "cuGraphLaunch 719 0", "starting a step: CUDA_ERROR_LAUNCH_FAILED (719)"),
        ("silent", "report 1 0", "a step ended without its report"),
    ] {
        let Some(said) = said(&format!("creation_{case}"), &[], fault) else { return };
        let line = said.lines().find(|line| line.starts_with("cuda: ")).expect("an answer");
        let why =
            line.strip_prefix("cuda: PLP_ERR_DEVICE: the GPU failed: ").unwrap_or_else(|| panic!("{said}"));
        assert!(why.ends_with(reason), "{why}");
        assert!(said.contains("\nauto: cpu, device -1, CPU, 1 thread; the GPU failed: "), "{said}");
    }
}

#[test]
fn a_surface_that_cannot_be_shown_says_so() {
    // Creation reads from the GPU once.
    let Some(full) = said("surface_full", &[], "cuMemcpyDtoHAsync_v2 2 1") else { return };
    let limit = "PLP_ERR_LIMIT: reading from the GPU: the GPU has too little free memory";
    // Steps go on, until the state itself cannot be read.
    assert!(full.contains(&format!("cuda: surface: {limit}\ncuda: energy: ")), "{full}");

    let Some(lost) = said("surface_lost", &[], "cuMemcpyDtoHAsync_v2 719 1") else { return };
    let loss = "PLP_ERR_DEVICE: the GPU failed: reading from the GPU: CUDA_ERROR_LAUNCH_FAILED (719)";
    assert!(lost.contains(&format!("cuda: surface: {loss}\ncuda: step 1: {loss}\n")), "{lost}");
}

#[test]
fn a_state_that_cannot_be_read_is_lost() {
    // Creation reads once, and the surface thrice.
    let Some(said) = said("unread", &[], "cuMemcpyDtoHAsync_v2 4711 4") else { return };
    let loss = "PLP_ERR_DEVICE: the GPU failed: reading from the GPU: status 4711";
    assert!(said.contains(&format!("cuda: energy: {loss}\ncuda: step 11: {loss}\n")), "{said}");
}

#[test]
fn a_gpu_that_is_lost_ends_its_simulation_and_nothing_else() {
    for (case, fault, reason) in [
        ("launch", "cuGraphLaunch 719 21", "starting a step: CUDA_ERROR_LAUNCH_FAILED (719)"),
        ("query", "cuStreamQuery 700 21", "a step on the GPU: CUDA_ERROR_ILLEGAL_ADDRESS (700)"),
        ("unknown", "cuStreamQuery 4711 21", "a step on the GPU: status 4711"),
        ("memory", "cuStreamQuery 2 21", "a step on the GPU: CUDA_ERROR_OUT_OF_MEMORY (2)"),
        ("silent", "report 1 21", "a step ended without its report"),
    ] {
        let Some(said) = said(&format!("lost_{case}"), &[], fault) else { return };
        assert!(said.contains("cuda: gpu, device 0, Fake 0; \n"), "{said}");
        let line =
            said.lines().find_map(|line| line.strip_prefix("cuda: step ")).expect("a step that failed");
        let (step, why) = line.split_once(": ").expect("a step and an answer");
        assert!((10..30).contains(&step.parse().unwrap_or(0)), "{line}");
        assert_eq!(why, format!("PLP_ERR_DEVICE: the GPU failed: {reason}"));
        assert!(said.contains("\nauto: cpu, device -1, CPU, 1 thread; the GPU failed: "), "{said}");
    }
}

#[test]
fn whatever_fails_and_whenever_the_program_ends_well() {
    let Some(dir) = fake_driver("any", &[]) else { return };
    let source = std::fs::read_to_string(root().join("tests/c/fake_driver.c")).expect("the driver's source");
    let functions: Vec<_> = source
        .lines()
        .filter_map(|line| line.strip_prefix("int cu")?.split('(').next())
        // The list of GPUs comes first, and must stand.
        .filter(|name| {
            !["Init", "GetErrorName", "DeviceTotalMem_v2"].contains(name) && !name.starts_with("DeviceGet")
        })
        .collect();
    assert!(functions.len() > 25, "{functions:?}");
    for function in functions {
        for (status, good) in [(719, 0), (719, 3), (4711, 1), (2, 7), (719, 30)] {
            said_with(&dir, &format!("cu{function} {status} {good}"));
        }
    }
}
