//! What Inventor nodes mean: transformations, windings, bindings, instances, repairs and error positions, on
//! small scenes.

use std::path::Path;

use glam::DVec3;
use wavelet_radiosity::scene::read::{ReadError, inventor};
use wavelet_radiosity::scene::{Face, Light, Projection, Scene, Sides, planar, validate};

const SQUARE: &str =
    "Coordinate3 { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] } IndexedFaceSet { coordIndex [ 0 1 2 3 ] }";

fn read(body: &str) -> Result<Scene, ReadError> {
    inventor::parse(&format!("#Inventor V2.1 ascii\n{body}"), Path::new("t.iv"))
}

fn scene(body: &str) -> Scene {
    read(body).unwrap_or_else(|error| panic!("{error}"))
}

fn error(body: &str) -> String {
    match read(body) {
        Ok(scene) => panic!("read {} faces", scene.faces.len()),
        Err(error) => error.to_string(),
    }
}

fn normal(face: &Face) -> DVec3 {
    planar::plane(&face.vertices).unwrap().normal
}

fn corners(face: &Face) -> Vec<[i64; 3]> {
    face.vertices.iter().map(|v| (*v * 1000.0).round().as_i64vec3().to_array()).collect()
}

fn reflectances(scene: &Scene) -> Vec<[f64; 3]> {
    let of = |face: &Face| &scene.materials[face.material as usize].reflectance;
    scene.faces.iter().map(|face| [0, 1, 2].map(|band| of(face)[band])).collect()
}

#[test]
fn transforms_compose_like_row_vectors() {
    // Scale, then turn X to Y, then move: the nodes stand in the opposite order.
    let scene = scene(&format!(
        "Translation {{ translation 10 0 0 }} RotationXYZ {{ axis Z angle 1.5707963268 }} Scale {{ scaleFactor 2 1 1 }} {SQUARE}"
    ));
    assert_eq!(corners(&scene.faces[0]), [[10000, 0, 0], [10000, 2000, 0], [9000, 2000, 0], [9000, 0, 0]]);
}

#[test]
fn transform_scales_about_its_center_along_turned_axes() {
    // Scaling by 2 along the diagonal x = y about (1, 1): (0, 0) goes to (−1, −1), (1, 0) and (0, 1) by half
    // of that.
    let scene = scene(&format!(
        "Transform {{ center 1 1 0 scaleFactor 2 1 1 scaleOrientation 0 0 1 0.7853981634 }} {SQUARE}"
    ));
    assert_eq!(
        corners(&scene.faces[0]),
        [[-1000, -1000, 0], [500, -500, 0], [1000, 1000, 0], [-500, 500, 0]]
    );
}

#[test]
fn a_written_matrix_holds_the_translation_in_its_last_row() {
    let scene = scene(&format!("MatrixTransform {{ matrix 1 0 0 0 0 0 1 0 0 -1 0 0 5 6 7 1 }} {SQUARE}"));
    assert_eq!(
        corners(&scene.faces[0]),
        [[5000, 6000, 7000], [6000, 6000, 7000], [6000, 6000, 8000], [5000, 6000, 8000]]
    );
}

#[test]
fn units_and_reset_transform() {
    let scene = scene(&format!(
        "Separator {{ Units {{ units CENTIMETERS }} Units {{ units INCHES }} {SQUARE} }}
         Translation {{ translation 5 5 5 }} ResetTransform {{ }} {SQUARE}"
    ));
    assert_eq!(corners(&scene.faces[0])[2], [25, 25, 0]);
    assert_eq!(corners(&scene.faces[1])[2], [1000, 1000, 0]);
}

#[test]
fn separators_scope_and_groups_leak() {
    let scene = scene(&format!(
        "Separator {{ Translation {{ translation 5 0 0 }} BaseColor {{ rgb 1 0 0 }} }}
         TransformSeparator {{ Translation {{ translation 5 0 0 }} BaseColor {{ rgb 0 0.5 0 }} }}
         Group {{ Translation {{ translation 0 3 0 }} }} {SQUARE}"
    ));
    assert_eq!(corners(&scene.faces[0])[0], [0, 3000, 0]);
    assert_eq!(reflectances(&scene), [[0.0, 0.5, 0.0]]);
}

#[test]
fn faces_end_counter_clockwise_from_their_front() {
    let hints = |ordering: &str| format!("ShapeHints {{ vertexOrdering {ordering} shapeType SOLID }}");
    let mirror = "Scale { scaleFactor 1 1 -1 }";
    for (before, up, sides) in [
        (String::new(), DVec3::Z, Sides::Two),
        (hints("COUNTERCLOCKWISE"), DVec3::Z, Sides::One),
        (hints("CLOCKWISE"), DVec3::NEG_Z, Sides::One),
        (hints("UNKNOWN_ORDERING"), DVec3::Z, Sides::Two),
        ("ShapeHints { vertexOrdering CLOCKWISE }".to_owned(), DVec3::NEG_Z, Sides::Two),
        // Mirrored, the front still looks where the transformation carries it.
        (hints("COUNTERCLOCKWISE") + mirror, DVec3::NEG_Z, Sides::One),
        (hints("CLOCKWISE") + mirror, DVec3::Z, Sides::One),
        // Fields not written mean their defaults; fields flagged by ~ stay as they were.
        (hints("CLOCKWISE") + "ShapeHints { shapeType SOLID }", DVec3::Z, Sides::Two),
        (hints("CLOCKWISE") + "ShapeHints { vertexOrdering ~ shapeType SOLID ~ }", DVec3::NEG_Z, Sides::One),
    ] {
        let scene = scene(&format!("{before} {SQUARE}"));
        assert_eq!((normal(&scene.faces[0]), scene.faces[0].sides), (up, sides), "{before}");
    }
}

#[test]
fn solids_face_outwards_and_enclose_their_volume() {
    for (solid, faces, volume) in [
        ("Cube { width 1 height 2 depth 3 }", 6, 6.0),
        ("Cylinder { radius 2 height 5 }", 14, 60.0),
        ("Cone { bottomRadius 2 height 4 }", 13, 16.0),
        ("Complexity { value 1 } Sphere { radius 1 }", 200, 4.0194),
        ("Complexity { value nan } Sphere { }", 8, 4.0 / 3.0),
        ("Scale { scaleFactor -1 1 1 } Cube { }", 6, 8.0),
    ] {
        let scene = scene(&format!("Translation {{ translation 1 2 3 }} {solid}"));
        assert_eq!(scene.faces.len(), faces, "{solid}");
        assert_eq!(scene.findings.repairs.len(), 0, "{:?}", scene.findings);
        let enclosed: f64 = scene
            .faces
            .iter()
            .map(|face| planar::plane(&face.vertices).unwrap())
            .map(|plane| plane.area_m2 * (plane.offset - plane.normal.dot(DVec3::new(1.0, 2.0, 3.0))) / 3.0)
            .sum();
        assert!((enclosed - volume).abs() < 1e-3, "{solid}: {enclosed}");
    }
    assert_eq!(scene("Cylinder { parts (SIDES | TOP) } Cone { parts BOTTOM }").faces.len(), 12 + 1 + 1);
}

#[test]
fn materials_bind_to_parts_faces_and_vertices() {
    let red = [0.9, 0.0, 0.0];
    let green = [0.0, 0.9, 0.0];
    let colors = "Material { diffuseColor [ 0.9 0 0, 0 0.9 0 ] }";
    let two = "Coordinate3 { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] }";
    for (binding, index, expected) in [
        ("OVERALL", "", [red, red]),
        ("PER_FACE", "", [red, green]),
        ("PER_PART", "", [red, green]),
        ("PER_FACE_INDEXED", "materialIndex [ 1 0 ]", [green, red]),
        ("PER_VERTEX", "", [[0.6, 0.3, 0.0], [0.3, 0.6, 0.0]]),
        ("PER_VERTEX_INDEXED", "materialIndex [ 0 0 1 -1 1 1 0 -1 ]", [[0.6, 0.3, 0.0], [0.3, 0.6, 0.0]]),
        ("PER_VERTEX_INDEXED", "", [[0.6, 0.3, 0.0], [0.6, 0.3, 0.0]]),
    ] {
        let scene = scene(&format!(
            "{colors} MaterialBinding {{ value {binding} }} {two}
             IndexedFaceSet {{ coordIndex [ 0 1 2 -1 0 2 3 -1 ] {index} }}"
        ));
        for (found, expected) in reflectances(&scene).iter().zip(expected) {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{binding}: {found:?}");
        }
    }
    let cube = scene(&format!("{colors} MaterialBinding {{ value PER_PART }} Cube {{ }}"));
    assert_eq!(reflectances(&cube), [red, green, red, green, red, green]);
}

#[test]
fn colours_set_one_by_one_keep_the_others() {
    let scene = scene(&format!(
        "Material {{ emissiveColor 5 6 7 }} PackedColor {{ orderedRGBA 0x3366ccff }} {SQUARE}
         PackedColor {{ rgba 0xffcc6633 }} Translation {{ translation 2 0 0 }} IndexedFaceSet {{ coordIndex [ 0 1 2 3 ]
         vertexProperty VertexProperty {{ vertex [ 0 0 1, 1 0 1, 1 1 1, 0 1 1 ] }} }}"
    ));
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.materials[0].exitance_w_m2, [5.0, 6.0, 7.0]);
    assert_eq!(scene.materials[0].reflectance, [0.2, 0.4, 0.8]);
    assert_eq!(corners(&scene.faces[1])[0], [2000, 0, 1000]);
}

#[test]
fn strips_and_meshes_keep_one_sense() {
    let points = "Coordinate3 { point [ 0 0 0, 0 -1 0, 1 0 0, 1 -1 0, 2 0 0, 2 -1 0 ] }";
    for (shape, faces) in [
        ("TriangleStripSet { numVertices [ 6 ] }", 4),
        ("TriangleStripSet { }", 4),
        ("IndexedTriangleStripSet { coordIndex [ 0 1 2 3 4 -1 5 4 3 ] }", 4),
        ("FaceSet { startIndex 1 numVertices [ 3 ] }", 1),
    ] {
        let scene = scene(&format!("{points} {shape}"));
        assert_eq!(scene.faces.len(), faces, "{shape}");
        let sense = if shape.starts_with("FaceSet") { -1.0 } else { 1.0 };
        assert!(scene.faces.iter().all(|face| normal(face).z == sense), "{shape}");
    }
    let mesh = "Coordinate3 { point [ 0 1 0, 1 1 0, 2 1 0, 0 0 0, 1 0 0, 2 0 0 ] }
                QuadMesh { verticesPerColumn 2 verticesPerRow 3 }";
    let scene = scene(mesh);
    assert_eq!(corners(&scene.faces[1]), [[1000, 1000, 0], [1000, 0, 0], [2000, 0, 0], [2000, 1000, 0]]);
}

#[test]
fn groups_choose_and_repeat_their_children() {
    let choice = "Cube { } Sphere { } Cone { }";
    for (group, faces) in [
        (format!("Switch {{ {choice} }}"), 0),
        (format!("Switch {{ whichChild 2 {choice} }}"), 13),
        (format!("Switch {{ whichChild -3 {choice} }}"), 6 + 72 + 13),
        (format!("Switch {{ whichChild 7 {choice} }}"), 0),
        (format!("Switch {{ whichChild 2 Cube {{ }} Cube {{ }} Switch {{ whichChild -2 {choice} }} }}"), 13),
        (format!("LOD {{ range [ 1 2 ] {choice} }}"), 6),
        ("Array { numElements1 3 numElements2 2 separation1 5 0 0 separation2 0 5 0 Cube { } }".to_owned(), 36),
        (format!("Array {{ numElements1 3 separation1 5 0 0 Switch {{ whichChild -2 {choice} }} }}"), 91),
        ("MultipleCopy { matrix [ 1 0 0 0 0 1 0 0 0 0 1 0 9 0 0 1, 1 0 0 0 0 1 0 0 0 0 1 0 0 9 0 1 ] Cube { } }".to_owned(), 12),
        ("MultipleCopy { Cube { } }".to_owned(), 0),
    ] {
        assert_eq!(scene(&group).faces.len(), faces, "{group}");
    }
    let array = scene("Array { numElements1 3 separation1 4 0 0 origin CENTER Cube { } }");
    assert_eq!(array.bounds_m(), Some((DVec3::new(-5.0, -1.0, -1.0), DVec3::new(5.0, 1.0, 1.0))));
}

#[test]
fn names_stand_for_nodes_after_their_bodies() {
    assert_eq!(scene("DEF a+0 Cube { } Translation { translation 9 0 0 } USE a+0").faces.len(), 12);
    assert_eq!(scene("DEF (odd=name)#1 Cube { } DEF x Group { } Switch { USE (odd=name)#1 }").faces.len(), 6);
    // A new definition with an old name may use the old one.
    assert_eq!(
        scene("DEF a Cube { } DEF a Separator { Translation { translation 9 0 0 } USE a }").faces.len(),
        12
    );
    assert_eq!(
        error("DEF a Separator {\n  USE a\n}"),
        "t.iv:3:7: expected a node that does not contain itself, found USE `a` inside the definition of `a`: a cycle; \
         take the instance out of its own body"
    );
    assert!(error("Cube { }\nUSE b").starts_with("t.iv:3:5: expected a name given by DEF"));
}

#[test]
fn unknown_nodes_describe_themselves() {
    let scene = scene(
        "Weird { fields [ SFFloat a, MFString b, SFNode c, SFBitMask d ] a 1 b [ \"x\", y ] c DEF n Cube { } d (A | B) Cube { } }
         Wide { fields [ MFString isA ] isA [ \"Odd\", \"Cube\" ] width 4 }
         Newer { fields [ SFNode alternateRep ] alternateRep Cone { } }
         Translation { translation = Calc { a 1 } . oA } Translation { translation 1 0 0 = USE n.width } Engine { in 5 ~ }",
    );
    assert_eq!(scene.faces.len(), 6 + 13);
    assert_eq!(scene.findings.skipped["Weird"], 1);
    assert_eq!(scene.findings.skipped["field connection"], 2);
}

#[test]
fn lights_and_cameras_arrive_in_world_coordinates() {
    let scene = scene(
        "Translation { translation 0 0 10 } RotationXYZ { axis X angle -1.5707963268 }
         PointLight { intensity 2 color 1 0.5 0 location 0 1 0 } PointLight { on FALSE }
         SpotLight { dropOffRate 0.5 cutOffAngle 0.3 } DirectionalLight { direction 0 2 0 }
         DEF front PerspectiveCamera { heightAngle 1 aspectRatio 1.5 } Scale { scaleFactor 3 3 3 } OrthographicCamera { }",
    );
    let [
        Light::Point { position, intensity_w_sr },
        Light::Spot { direction, exponent, .. },
        Light::Directional { direction: sun, .. },
    ] = &scene.lights[..]
    else {
        panic!("{:?}", scene.lights)
    };
    assert!(position.distance(DVec3::new(0.0, 0.0, 9.0)) < 1e-9 && intensity_w_sr == &[2.0, 1.0, 0.0]);
    assert!(
        direction.distance(DVec3::NEG_Y) < 1e-9 && *exponent == 64.0 && sun.distance(DVec3::NEG_Z) < 1e-9
    );
    let [front, other] = &scene.cameras[..] else { panic!("{:?}", scene.cameras) };
    assert!(front.direction.distance(DVec3::NEG_Y) < 1e-9 && front.up.distance(DVec3::NEG_Z) < 1e-9);
    assert_eq!((&*front.name, front.projection, front.aspect), ("front", Projection::Perspective(1.0), 1.5));
    assert!(
        matches!(other.projection, Projection::Orthographic(h) if (h - 6.0).abs() < 1e-9)
            && other.name == "camera2"
    );
}

#[test]
fn errors_name_line_column_and_remedy() {
    for (body, message) in [
        (
            "Cube { width x }",
            "2:14: expected a number for the field `width` of `Cube`, found `x`; write the missing number",
        ),
        (
            "Translation { translation 1 2 }",
            "2:31: expected number 3 of 3 for the field `translation` of `Translation`",
        ),
        (
            "Separator {\n  Cube { }\n",
            "4:1: expected a field or child of `Separator`, or `}` to end it, found the end of the file",
        ),
        ("Coordinate3 { point [ 1 2 3, 4 ] }", "2:32: expected a multiple of 3 numbers"),
        ("IndexedFaceSet { coordIndex [ 0 1.5 ] }", "2:33: expected an integer for the field `coordIndex`"),
        ("Group { } }", "2:11: expected a node (`Type { … }`, DEF or USE), found `}`"),
        ("ShapeHints { shapeType HOLLOW }", "2:24: expected one of UNKNOWN_SHAPE_TYPE, SOLID"),
        ("Info { string \"a\nb }", "2:15: expected a string closed by `\"`, found the end of the file"),
        ("Cube", "2:5: expected `{` after the node type `Cube`, found the end of the file"),
        ("Text2 { string }", "2:16: expected a value for the field `string`, found `}`"),
        ("Translation { translation 1 2 3 = Foo { } }", "2:43: expected `.` and the name of an output"),
    ] {
        let found = error(body);
        assert!(found.starts_with(&format!("t.iv:{message}")), "{body}: {found}");
    }
    for (text, found) in [
        ("", "found an empty line"),
        ("#Inventor V2.1 binary  \n", "found `#Inventor V2.1 binary`; convert it to text with `ivcat"),
        ("#VRML V1.0 binary", "found `#VRML V1.0 binary`"),
        ("solid cube", "found `solid cube`"),
    ] {
        let error = inventor::parse(text, Path::new("t.iv")).unwrap_err().to_string();
        assert!(
            error.starts_with("t.iv:1:1: expected `#Inventor V2.1 ascii`") && error.contains(found),
            "{error}"
        );
    }
}

#[test]
fn sloppy_files_are_read_as_meant() {
    let text = "\u{feff}#Inventor V2.1 ascii extra\r\nSeparator{#c\r\nCoordinate3{point[0,0,0,,1 0 0#c\r\n 1,1,0 0 1 0,]}\
                IndexedFaceSet{coordIndex[0,1,2,3]}FaceSet{numVertices[]}IndexedFaceSet{coordIndex[]}\
                Material{diffuseColor[]}IndexedFaceSet{coordIndex[3,2,1,-1,-1,9,1,2,-1,0,1,-1]}}";
    let scene = inventor::parse(text, Path::new("t.iv")).unwrap();
    assert_eq!(scene.faces.len(), 2);
    assert_eq!(reflectances(&scene)[1], [0.8; 3]);
    let repairs: Vec<_> =
        scene.findings.repairs.iter().map(|(rule, finding)| (&**rule, finding.count)).collect();
    assert_eq!(
        repairs,
        [
            ("face with a coordinate index out of range dropped", 1),
            ("face with fewer than three vertices dropped", 1)
        ]
    );
}

#[test]
fn repairs_follow_their_rules_and_name_the_first_place() {
    let mut scene = scene(&format!(
        "Material {{ diffuseColor 1 -1 nan emissiveColor -1 inf 900 }}\n{SQUARE}\n{SQUARE}
         IndexedFaceSet {{ coordIndex [ 2 1 0 3 ] }}
         Coordinate3 {{ point [ 0 0 0, 1 0 0, 1 0 0, 2 0 0, nan 0 0, 0 5 0, 1 5 0.00001, 1 6 0, 0 6 0, 1 5 3 ] }}
         IndexedFaceSet {{ coordIndex [ 0 1 3 -1 0 1 4 -1 0 0 1 2 5 6 5 -1 5 6 7 8 -1 5 9 7 8 ] }}"
    ));
    assert_eq!(scene.materials[0].reflectance, [0.999, 0.0, 0.0]);
    assert_eq!(scene.materials[0].exitance_w_m2, [0.0, 0.0, 900.0]);
    let repairs: Vec<_> =
        scene.findings.repairs.iter().map(|(rule, finding)| format!("{} {rule}", finding.count)).collect();
    assert_eq!(
        repairs,
        [
            "1 exitance below 0 set to 0",
            "1 exitance that is not a finite number set to 0",
            "2 face drawn twice dropped",
            "1 face with a coordinate that is not a number or beyond 1e30 m dropped",
            "1 face without area dropped",
            "1 non-planar face split into planar pieces",
            "1 reflectance above 0.999 set to 0.999",
            "1 reflectance below 0 set to 0",
            "1 reflectance that is not a number set to 0",
            "2 repeated corner dropped",
            "1 slightly non-planar face flattened",
            "1 spike dropped",
        ]
    );
    assert_eq!(scene.findings.repairs["face drawn twice dropped"].first, "t.iv:4:54");
    assert_eq!(scene.faces.len(), 1 + 1 + 1 + 2);
    let again = scene.clone();
    validate(&mut scene);
    assert_eq!(format!("{again:?}"), format!("{scene:?}"));
}

#[test]
fn small_files_cannot_ask_for_unbounded_work() {
    let doubling = |leaf: &str| {
        let levels = (1..60).map(|i| format!("DEF n{i} Group {{ USE n{} USE n{} }}\n", i - 1, i - 1));
        format!("DEF n0 {leaf} {}", levels.collect::<String>())
    };
    let limits = inventor::Limits { faces: 1000, steps: 100_000 };
    for (body, expected) in [
        (doubling("Group { }"), "at most 100000 nodes"),
        (doubling("Cube { }"), "at most 1000 faces"),
        (doubling("PointLight { }"), "at most 1000 faces"),
        ("Array { numElements1 2000000000 numElements2 2000000000 }".to_owned(), "at most 100000 nodes"),
        (
            "Array { numElements1 0 numElements2 2000000000 numElements3 2000000000 Cube { } }".to_owned(),
            "at most 100000",
        ),
        (format!("{}FaceSet {{ numVertices [ {} ] }}", "Group { } ", "0 ".repeat(200_000)), "at most 100000"),
        ("QuadMesh { verticesPerColumn 2000000000 verticesPerRow 2000000000 }".to_owned(), ""),
    ] {
        let text = format!("#Inventor V2.1 ascii\n{body}");
        match inventor::parse_within(&text, Path::new("t.iv"), &limits) {
            Ok(scene) => assert!(expected.is_empty() && scene.faces.is_empty(), "{expected}"),
            Err(error) => assert!(!expected.is_empty() && error.to_string().contains(expected), "{error}"),
        }
    }
}

#[test]
fn deep_nesting_is_an_error_on_a_small_stack() {
    let nested = |n: usize| format!("{} Cube {{ }} {}", "Separator {".repeat(n), "}".repeat(n));
    let chain = |n: usize| {
        let links = (1..n).map(|i| format!("DEF n{i} Group {{ USE n{} }}\n", i - 1));
        format!(
            "DEF n0 Cube {{ }} Translation {{ translation 9 0 0 }} Switch {{ {} }} USE n{}",
            links.collect::<String>(),
            n - 1
        )
    };
    let work = move || {
        assert_eq!(scene(&nested(390)).faces.len(), 6);
        assert_eq!(scene(&chain(390)).faces.len(), 12);
        for body in [nested(100_000), chain(1000), "X { a ".repeat(100_000), "X { a [ ".repeat(100_000)] {
            assert!(error(&body).contains("expected at most 400 nodes nested"));
        }
    };
    std::thread::Builder::new().stack_size(1 << 20).spawn(work).unwrap().join().unwrap();
}

#[test]
fn includes_are_sought_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, body: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("#Inventor V2.1 ascii\n{body}")).unwrap();
        path
    };
    let read = |path: &Path| wavelet_radiosity::scene::read::read_file(path);
    write("part.iv", "Translation { translation 5 0 0 } Cube { }");
    let main = write(
        "main.iv",
        "File { name \"part.iv\" } File { name \"part.iv\" } File { name \"gone.iv\" } File { } Translation { translation 3 0 0 } Cube { }",
    );
    let scene = read(&main).unwrap();
    assert_eq!((&*scene.name, scene.faces.len()), ("main", 18));
    // A file acts like a group: its translation stays.
    assert_eq!(scene.bounds_m().unwrap(), (DVec3::new(4.0, -1.0, -1.0), DVec3::new(14.0, 1.0, 1.0)));
    let missing = &scene.findings.repairs["included file missing, left out"];
    assert!(missing.count == 1 && missing.first.ends_with("main.iv:2:49: gone.iv"), "{missing:?}");
    write("bad.iv", "Cube { width }");
    let error = read(&write("uses-bad.iv", "File { name \"bad.iv\" }")).unwrap_err().to_string();
    assert!(error.contains("bad.iv:2:14: expected a number"), "{error}");
    write("a.iv", "File { name \"b.iv\" }");
    let error = read(&write("b.iv", "Group { File { name \"a.iv\" } }")).unwrap_err().to_string();
    assert!(error.contains("a.iv:2:1: expected a file that does not include itself"), "{error}");
    std::fs::write(folder.path().join("z.iv"), [0x1f, 0x8b, 8, 0]).unwrap();
    let error = read(&folder.path().join("z.iv")).unwrap_err().to_string();
    assert!(
        error.contains("z.iv:1:1: expected text, found a gzip-compressed file; decompress it"),
        "{error}"
    );
    assert!(
        read(&folder.path().join("none.iv")).unwrap_err().to_string().contains("none.iv: cannot be read")
    );
}

#[test]
fn vrml97_shapes_take_their_appearance() {
    let text = "#VRML V2.0 utf8\nPROTO P [ field SFFloat r 1 ] { Shape { geometry Sphere { radius IS r } } }\n
        DEF T Transform { translation 0 0 5 children [ Shape {
          appearance Appearance { material Material { diffuseColor 0.2 0.3 0.4 } }
          geometry IndexedFaceSet { ccw FALSE coord Coordinate { point [ 0 0 0, 1 0 0, 0 1 0 ] } coordIndex [ 0 1 2 -1 ] } }
          P { r 2 } ] }
        Shape { geometry Box { size 1 2 3 } } ROUTE T.x TO T.y";
    let scene = inventor::parse(text, Path::new("t.wrl")).unwrap();
    assert_eq!(scene.faces.len(), 7);
    assert_eq!((normal(&scene.faces[0]), scene.faces[0].vertices[0].z), (DVec3::NEG_Z, 5.0));
    assert_eq!(reflectances(&scene)[..2], [[0.2, 0.3, 0.4], [0.8; 3]]);
    assert_eq!(scene.bounds_m().unwrap().0, DVec3::new(-0.5, -1.0, -1.5));
}
