//! Point clouds of each form, and damaged ones.

use std::path::Path;

use super::*;

const POINTS: [[f64; 3]; 2] = [[1.0, -2.5, 3.25], [0.5, 8.0, -0.125]];

/// What is read of a file with this name and content.
fn read(name: &str, content: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    let strip = |error: ReadError| error.to_string().replace(&format!("{}/", folder.path().display()), "");
    read_point_cloud(&path).map_err(strip)
}

fn binary_ply(format: &str, bytes: impl Fn(f32) -> [u8; 4]) -> Vec<u8> {
    let header = format!(
        "ply\r\nformat {format} 1.0\r\ncomment a\r\nelement vertex 2\r\nproperty uchar red\r\nproperty float x\r\n\
         property float32 y\r\nproperty float z\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n"
    );
    let mut content = header.into_bytes();
    for point in POINTS {
        content.push(200);
        point.iter().for_each(|x| content.extend(bytes(*x as f32)));
    }
    content.extend([3, 0, 0, 0]);
    content
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00".as_slice(), length.as_slice(), header.as_bytes(), data].concat()
}

#[test]
fn every_form_has_the_same_points() {
    let floats = |columns: usize| -> Vec<u8> {
        let row = |p: &[f64; 3]| p.iter().copied().chain([7.0; 9]).take(columns).map(|x| x as f32).collect::<Vec<_>>();
        POINTS.iter().flat_map(row).flat_map(f32::to_le_bytes).collect()
    };
    let doubles: Vec<u8> = POINTS.iter().flatten().flat_map(|x| x.to_be_bytes()).collect();
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double z\nproperty double x\nproperty double y\nend_header\n\
                3.25 1 -2.5\n-0.125 5e-1 8\n";
    for (name, content) in [
        ("a.bin", floats(4)),
        ("a.pcd.bin", floats(5)),
        ("a.npy", npy("<f4", "2, 4", &floats(4))),
        ("a.npy", npy(">f8", "2, 3", &doubles)),
        ("a.PLY", binary_ply("binary_little_endian", f32::to_le_bytes)),
        ("a.ply", binary_ply("binary_big_endian", f32::to_be_bytes)),
        ("a.ply", text.as_bytes().to_vec()),
        ("a.csv", b"x,y,z,i\n1,-2.5,3.25,9\n0.5,8,-0.125,9\n".to_vec()),
        ("a.xyz", b"# none\n1 -2.5 3.25\n\n0.5 8 -0.125\n".to_vec()),
    ] {
        assert_eq!(read(name, &content), Ok(POINTS.to_vec()), "{name}");
    }
    // What is not measured is left out.
    let with_gap = [floats(4), [f32::NAN; 4].iter().flat_map(|x| x.to_le_bytes()).collect()].concat();
    assert_eq!(read("a.bin", &with_gap).unwrap().len(), 2);
    assert_eq!(read("a.bin", b""), Ok(Vec::new()));
}

#[test]
fn damaged_files_are_named_with_the_place() {
    let message = |name: &str, content: &[u8]| read(name, content).unwrap_err();
    let binary = binary_ply("binary_little_endian", f32::to_le_bytes);
    for length in 0..binary.len() - 4 {
        assert!(read("a.ply", &binary[..length]).is_err(), "{length}");
    }
    let array = npy("<f8", "2, 3", &[0; 48]);
    for length in 0..array.len() {
        assert!(read("a.npy", &array[..length]).is_err(), "{length}");
    }
    let ascii = |vertices: &str| {
        let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        message("a.ply", format!("{header}{vertices}").as_bytes())
    };
    insta::assert_snapshot!([
        message("a.las", b"LASF"),
        message("a.bin", &[0; 30]),
        message("a.csv", b"x,y\n1,2\n"),
        message("a.csv", b"x,y,z\n1,2,3\n1,a,3\n"),
        message("a.ply", b"solid\n"),
        message("a.ply", b"ply\nformat ascii 2.0\n"),
        message("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"),
        message("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n1\n"),
        message("a.ply", b"ply\nformat ascii 1.0\nelement face 1\n"),
        message("a.ply", b"ply\nelement vertex 18446744073709551615\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
        message("a.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 18446744073709551615\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
        ascii("1 2 3\n"),
        ascii("1 2 3\n4 5\n"),
        ascii("1 2 3\n4 5 z\n"),
        message("a.npy", b"PK"),
        message("a.npy", &npy("<i4", "2, 3", &[0; 24])),
        message("a.npy", &npy("<f4", "6,", &[0; 24])),
        message("a.npy", &npy("<f4", "18446744073709551615, 3", &[0; 24])),
    ].join("\n"), @r#"
a.las: this is no point cloud: expected .ply, .bin (KITTI's x, y, z, reflectance; nuScenes' .pcd.bin), .npy, .csv, .txt or .xyz
a.bin: the file has 30 bytes; expected a multiple of 16, 4 32-bit floats a point
a.csv:2: found 2 numbers; expected x, y, z
a.csv:3: column 2 is "a"; expected a number
a.ply:1: this is no PLY file: expected "ply"
a.ply:2: found "format ascii 2.0"; expected the format ascii, binary_little_endian or binary_big_endian, version 1.0
a.ply: the vertices have the properties x; expected x, y, z
a.ply:4: found "property list uchar int x"; expected a number, not a list, for each vertex
a.ply:3: found "element face 1"; expected the vertices first
a.ply: the header has no line "format"
a.ply: the file ends 0 bytes after its header; expected 18446744073709551615 vertices of 12 bytes
a.ply: the file ends after 1 vertices; expected 2
a.ply:9: found 2 numbers; expected 3 of a vertex
a.ply:9: found "z"; expected a number
a.npy: this is no array of numpy (.npy)
a.npy: the array has the type <i4; expected <f4 or <f8 (32- or 64-bit floats)
a.npy: the array has the shape (6,); expected (N, 3) or more columns
a.npy: the file ends 24 bytes after its header; expected 18446744073709551615 x 3 numbers
"#);
    assert!(message("a.npy", &npy("<f4", "2, 3", &[0; 23])).contains("expected 2 x 3 numbers"));
    assert!(read_point_cloud(Path::new("/no/a.bin")).unwrap_err().to_string().contains("there is no such file"));
}
