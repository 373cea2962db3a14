//! The node types this reader interprets, with the fields it needs and how their values are written.
//!
//! Every node type that stands here has a meaning for radiosity; every other node and field is parsed by
//! shape, skipped and counted.

use Form::{Bits, Flag, Float, Floats, Integers, Nodes, OneOf, Strings};

/// How a field's value is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Exactly so many numbers.
    Float(usize),
    /// Any multiple of so many numbers in brackets, or just so many.
    Floats(usize),
    /// Integers in brackets, or one.
    Integers,
    /// `TRUE` or `FALSE`.
    Flag,
    /// One of these words.
    OneOf(&'static [&'static str]),
    /// One of these words, or several as `(A | B)`.
    Bits(&'static [&'static str]),
    /// Strings in brackets, or one.
    Strings,
    /// Nodes in brackets, or one.
    Nodes,
    /// One node or `NULL`.
    Node,
}

/// What a node does when it is visited: each is the node type of that name in the Inventor reference manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Separator,
    Group,
    TransformSeparator,
    Switch,
    FirstChild,
    Array,
    MultipleCopy,
    File,
    Transform,
    Translation,
    Rotation,
    RotationXyz,
    Scale,
    MatrixTransform,
    ResetTransform,
    Units,
    Coordinate3,
    Coordinate4,
    VertexProperty,
    Material,
    BaseColor,
    PackedColor,
    MaterialBinding,
    ShapeHints,
    Complexity,
    DrawStyle,
    FaceSet,
    IndexedFaceSet,
    TriangleStripSet,
    IndexedTriangleStripSet,
    QuadMesh,
    Cube,
    Sphere,
    Cone,
    Cylinder,
    PointLight,
    SpotLight,
    DirectionalLight,
    PerspectiveCamera,
    OrthographicCamera,
    Shape97,
    Appearance97,
    /// Not interpreted.
    Other,
}

/// A node type: its name in files, what it does, its fields.
#[derive(Debug)]
pub struct Spec {
    /// The name in files.
    pub name: &'static str,
    /// What it does.
    pub kind: Kind,
    /// Names and forms of the fields that matter.
    pub fields: &'static [(&'static str, Form)],
}

/// Values of `MaterialBinding`, also used inside `VertexProperty`.
pub const BINDINGS: &[&str] = &[
    "OVERALL",
    "PER_PART",
    "PER_PART_INDEXED",
    "PER_FACE",
    "PER_FACE_INDEXED",
    "PER_VERTEX",
    "PER_VERTEX_INDEXED",
    "DEFAULT",
    "NONE",
];
const UNITS: &[&str] = &[
    "METERS",
    "CENTIMETERS",
    "MILLIMETERS",
    "MICROMETERS",
    "MICRONS",
    "NANOMETERS",
    "ANGSTROMS",
    "KILOMETERS",
    "FEET",
    "INCHES",
    "POINTS",
    "YARDS",
    "MILES",
    "NAUTICAL_MILES",
];
const ORDERINGS: &[&str] = &["UNKNOWN_ORDERING", "CLOCKWISE", "COUNTERCLOCKWISE"];
const SHAPE_TYPES: &[&str] = &["UNKNOWN_SHAPE_TYPE", "SOLID"];
const STYLES: &[&str] = &["FILLED", "LINES", "POINTS", "INVISIBLE"];
const CONE_PARTS: &[&str] = &["SIDES", "BOTTOM", "ALL"];
const CYLINDER_PARTS: &[&str] = &["SIDES", "TOP", "BOTTOM", "ALL"];

const INDEXED: &[(&str, Form)] =
    &[("coordIndex", Integers), ("materialIndex", Integers), ("vertexProperty", Form::Node)];
const STRIPS: &[(&str, Form)] =
    &[("startIndex", Integers), ("numVertices", Integers), ("vertexProperty", Form::Node)];
const ARRAY: &[(&str, Form)] = &[
    ("numElements1", Integers),
    ("numElements2", Integers),
    ("numElements3", Integers),
    ("separation1", Float(3)),
    ("separation2", Float(3)),
    ("separation3", Float(3)),
    ("origin", OneOf(&["FIRST", "CENTER", "LAST"])),
];
const TRANSFORM: &[(&str, Form)] = &[
    ("translation", Float(3)),
    ("rotation", Float(4)),
    ("scaleFactor", Float(3)),
    ("scaleOrientation", Float(4)),
    ("center", Float(3)),
];
const QUADS: &[(&str, Form)] = &[
    ("startIndex", Integers),
    ("verticesPerColumn", Integers),
    ("verticesPerRow", Integers),
    ("vertexProperty", Form::Node),
];
const VERTICES: &[(&str, Form)] =
    &[("vertex", Floats(3)), ("orderedRGBA", Integers), ("materialBinding", OneOf(BINDINGS))];
const MATERIAL: &[(&str, Form)] =
    &[("diffuseColor", Floats(3)), ("emissiveColor", Floats(3)), ("transparency", Floats(1))];
const POINT_LIGHT: &[(&str, Form)] =
    &[("on", Flag), ("intensity", Float(1)), ("color", Float(3)), ("location", Float(3))];
const SPOT_LIGHT: &[(&str, Form)] = &[
    ("on", Flag),
    ("intensity", Float(1)),
    ("color", Float(3)),
    ("location", Float(3)),
    ("direction", Float(3)),
    ("dropOffRate", Float(1)),
    ("cutOffAngle", Float(1)),
];
const DIRECTIONAL_LIGHT: &[(&str, Form)] =
    &[("on", Flag), ("intensity", Float(1)), ("color", Float(3)), ("direction", Float(3))];
const PERSPECTIVE: &[(&str, Form)] = &[
    ("position", Float(3)),
    ("orientation", Float(4)),
    ("aspectRatio", Float(1)),
    ("heightAngle", Float(1)),
];
const ORTHOGRAPHIC: &[(&str, Form)] =
    &[("position", Float(3)), ("orientation", Float(4)), ("aspectRatio", Float(1)), ("height", Float(1))];

const fn spec(name: &'static str, kind: Kind, fields: &'static [(&'static str, Form)]) -> Spec {
    Spec { name, kind, fields }
}

/// Open Inventor 1.0 to 2.1 and VRML 1.0.
static INVENTOR: &[Spec] = &[
    spec("Separator", Kind::Separator, &[]),
    spec("Group", Kind::Group, &[]),
    spec("TransformSeparator", Kind::TransformSeparator, &[]),
    spec("Annotation", Kind::Separator, &[]),
    spec("Selection", Kind::Separator, &[]),
    spec("ExtSelection", Kind::Separator, &[]),
    spec("LocateHighlight", Kind::Separator, &[]),
    spec("WWWAnchor", Kind::Separator, &[]),
    spec("Switch", Kind::Switch, &[("whichChild", Integers)]),
    spec("LOD", Kind::FirstChild, &[]),
    spec("LevelOfDetail", Kind::FirstChild, &[]),
    spec("Blinker", Kind::FirstChild, &[]),
    spec("Array", Kind::Array, ARRAY),
    spec("MultipleCopy", Kind::MultipleCopy, &[("matrix", Floats(16))]),
    spec("File", Kind::File, &[("name", Strings)]),
    spec("WWWInline", Kind::File, &[("name", Strings)]),
    spec("Transform", Kind::Transform, TRANSFORM),
    spec("Translation", Kind::Translation, &[("translation", Float(3))]),
    spec("Rotation", Kind::Rotation, &[("rotation", Float(4))]),
    spec("Rotor", Kind::Rotation, &[("rotation", Float(4))]),
    spec("RotationXYZ", Kind::RotationXyz, &[("axis", OneOf(&["X", "Y", "Z"])), ("angle", Float(1))]),
    spec("Scale", Kind::Scale, &[("scaleFactor", Float(3))]),
    spec("MatrixTransform", Kind::MatrixTransform, &[("matrix", Float(16))]),
    spec("ResetTransform", Kind::ResetTransform, &[("whatToReset", Bits(&["TRANSFORM", "BBOX"]))]),
    spec("Units", Kind::Units, &[("units", OneOf(UNITS))]),
    spec("Coordinate3", Kind::Coordinate3, &[("point", Floats(3))]),
    spec("Coordinate4", Kind::Coordinate4, &[("point", Floats(4))]),
    spec("VertexProperty", Kind::VertexProperty, VERTICES),
    spec("Material", Kind::Material, MATERIAL),
    spec("BaseColor", Kind::BaseColor, &[("rgb", Floats(3))]),
    spec("PackedColor", Kind::PackedColor, &[("orderedRGBA", Integers), ("rgba", Integers)]),
    spec("MaterialBinding", Kind::MaterialBinding, &[("value", OneOf(BINDINGS))]),
    spec(
        "ShapeHints",
        Kind::ShapeHints,
        &[("vertexOrdering", OneOf(ORDERINGS)), ("shapeType", OneOf(SHAPE_TYPES))],
    ),
    spec("Complexity", Kind::Complexity, &[("value", Float(1))]),
    spec("DrawStyle", Kind::DrawStyle, &[("style", OneOf(STYLES))]),
    spec("FaceSet", Kind::FaceSet, STRIPS),
    spec("IndexedFaceSet", Kind::IndexedFaceSet, INDEXED),
    spec("TriangleStripSet", Kind::TriangleStripSet, STRIPS),
    spec("IndexedTriangleStripSet", Kind::IndexedTriangleStripSet, INDEXED),
    spec("QuadMesh", Kind::QuadMesh, QUADS),
    spec("Cube", Kind::Cube, &[("width", Float(1)), ("height", Float(1)), ("depth", Float(1))]),
    spec("Sphere", Kind::Sphere, &[("radius", Float(1))]),
    spec(
        "Cone",
        Kind::Cone,
        &[("parts", Bits(CONE_PARTS)), ("bottomRadius", Float(1)), ("height", Float(1))],
    ),
    spec(
        "Cylinder",
        Kind::Cylinder,
        &[("parts", Bits(CYLINDER_PARTS)), ("radius", Float(1)), ("height", Float(1))],
    ),
    spec("PointLight", Kind::PointLight, POINT_LIGHT),
    spec("SpotLight", Kind::SpotLight, SPOT_LIGHT),
    spec("DirectionalLight", Kind::DirectionalLight, DIRECTIONAL_LIGHT),
    spec("PerspectiveCamera", Kind::PerspectiveCamera, PERSPECTIVE),
    spec("OrthographicCamera", Kind::OrthographicCamera, ORTHOGRAPHIC),
];

/// The part of VRML97 that is read.
static VRML97: &[Spec] = &[
    spec("Group", Kind::Separator, &[("children", Nodes)]),
    spec("Anchor", Kind::Separator, &[("children", Nodes)]),
    spec("Collision", Kind::Separator, &[("children", Nodes)]),
    spec(
        "Transform",
        Kind::Transform,
        &[
            ("children", Nodes),
            ("translation", Float(3)),
            ("rotation", Float(4)),
            ("scale", Float(3)),
            ("scaleOrientation", Float(4)),
            ("center", Float(3)),
        ],
    ),
    spec("Switch", Kind::Switch, &[("choice", Nodes), ("whichChoice", Integers)]),
    spec("LOD", Kind::FirstChild, &[("level", Nodes)]),
    spec("Inline", Kind::File, &[("url", Strings)]),
    spec("Shape", Kind::Shape97, &[("appearance", Form::Node), ("geometry", Form::Node)]),
    spec("Appearance", Kind::Appearance97, &[("material", Form::Node)]),
    spec(
        "Material",
        Kind::Material,
        &[("diffuseColor", Float(3)), ("emissiveColor", Float(3)), ("transparency", Float(1))],
    ),
    spec("Coordinate", Kind::Coordinate3, &[("point", Floats(3))]),
    spec(
        "IndexedFaceSet",
        Kind::IndexedFaceSet,
        &[("coord", Form::Node), ("coordIndex", Integers), ("ccw", Flag), ("solid", Flag)],
    ),
    spec("Box", Kind::Cube, &[("size", Float(3))]),
    spec("Sphere", Kind::Sphere, &[("radius", Float(1))]),
    spec(
        "Cone",
        Kind::Cone,
        &[("bottomRadius", Float(1)), ("height", Float(1)), ("side", Flag), ("bottom", Flag)],
    ),
    spec(
        "Cylinder",
        Kind::Cylinder,
        &[("radius", Float(1)), ("height", Float(1)), ("side", Flag), ("top", Flag), ("bottom", Flag)],
    ),
    spec("PointLight", Kind::PointLight, POINT_LIGHT),
    spec("DirectionalLight", Kind::DirectionalLight, DIRECTIONAL_LIGHT),
];

/// The interpreted node type called `name`; Inventor's may carry their class prefix `So`.
pub fn find(name: &str, vrml97: bool) -> Option<&'static Spec> {
    if vrml97 {
        return VRML97.iter().find(|spec| spec.name == name);
    }
    let plain = |name: &str| INVENTOR.iter().find(|spec| spec.name == name);
    plain(name).or_else(|| plain(name.strip_prefix("So")?))
}
