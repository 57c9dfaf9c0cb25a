// Soft shadows and contact shadows from a sphere set (GLSL 1.30, GLSL ES 3.00 and later).
//
// How to bind the spheres: a texture of one row, GL_RGBA32F, unfiltered, one texel a sphere: centre and radius, in the
// coordinates of the receiver. With a uniform array or a storage buffer only `sphereAt` changes.
// Put the spheres on what receives from *other* objects: a mesh's own surface lies inside its spheres.

uniform sampler2D spheres;
uniform int sphereCount;

const float PI = 3.14159265358979;

// Spheres bulge out of the mesh that they stand for. Where a receiver comes so near that sphere radius / distance would
// exceed this, or lies inside, the sphere counts as one that just fills this much: 1 darkens every point in a bulge.
const float NEAREST = 0.9;

vec4 sphereAt(int index) {
    return texelFetch(spheres, ivec2(index, 0), 0);
}

// The part of a disc of radius `radius` that a chord cuts off, `away` from its centre (negative: more than half).
float segmentArea(float radius, float away) {
    float halfChord = sqrt(max(0.0, radius * radius - away * away));
    return radius * radius * atan(halfChord, away) - away * halfChord;
}

// The share of a disc of radius `disc` that a disc of radius `other` covers, their centres `apart`: a lens, made of
// two segments that meet at the common chord (E. Weisstein, "Circle-Circle Intersection", MathWorld).
float coveredShare(float disc, float other, float apart) {
    if (apart >= disc + other) return 0.0;
    if (apart <= abs(disc - other)) return other >= disc ? 1.0 : (other * other) / (disc * disc);
    float chord = ((apart - other) * (apart + other) + disc * disc) / (2.0 * apart);
    float lens = segmentArea(disc, chord) + segmentArea(other, apart - chord);
    return clamp(lens / (PI * disc * disc), 0.0, 1.0);
}

// The share of a round light that one sphere hides from `point`. The light is seen in direction `light`, a unit vector,
// as a disc of angular radius `angle`, which should stay below 0.5 (the sun: 0.0047; a soft studio lamp: 0.1 to 0.3).
// Both are caps on the sphere of directions. Seen from the light (stereographic projection) caps are discs on a plane,
// with exact borders; only areas grow towards the light's rim, by 2 tan^2(angle / 2) (for an angle of 0.3 by 5 %).
float hiddenBySphere(vec3 point, vec3 light, float angle, vec4 sphere) {
    vec3 toCentre = sphere.xyz - point;
    float away = max(length(toCentre), 1e-20);
    float cap = asin(min(NEAREST, sphere.w / away));
    vec3 direction = toCentre / away;
    float between = atan(length(cross(light, direction)), dot(light, direction));
    if (between >= cap + angle) return 0.0;
    float near = tan((between - cap) / 2.0);
    float far = tan(min(between + cap, 3.1) / 2.0);  // a cap around the point opposite the light would have no far end
    return coveredShare(tan(angle / 2.0), (far - near) / 2.0, (far + near) / 2.0);
}

// The share of the sky over a surface with normal `normal` that one sphere hides, weighted by the cosine to the normal:
// (radius / distance)^2 * cosine, and where the sphere dips below the horizon the form factor of what is above it
// (J. Snyder, "Area Light Sources for Real-Time Graphics", 1996; as in S. Lagarde, C. de Rousiers, "Moving Frostbite to
// Physically Based Rendering", SIGGRAPH 2014 course).
float skyHiddenBySphere(vec3 point, vec3 normal, vec4 sphere) {
    vec3 toCentre = sphere.xyz - point;
    float away2 = max(dot(toCentre, toCentre), 1e-20);
    float cosine = clamp(dot(normal, toCentre) * inversesqrt(away2), -0.9999, 0.9999);
    float sine2 = min(sphere.w * sphere.w / away2, NEAREST * NEAREST);
    if (cosine * cosine >= sine2) return max(0.0, cosine) * sine2;
    float sine = sqrt(1.0 - cosine * cosine);
    float cotangent = sqrt(1.0 / sine2 - 1.0);  // of half the angle that the sphere fills
    float horizon = -cotangent * cosine / sine;
    float width = sine * sqrt(1.0 - horizon * horizon);
    return ((cosine * acos(horizon) - cotangent * width) * sine2 + atan(width, cotangent)) / PI;
}

// The share of the light that gets past all spheres. The product assumes that spheres hide the light independently of
// each other, as if placed by chance: where they hide the same part of it the shadow is too dark, where they hide parts
// side by side too light; where one of them hides all, or only one hides any, it is exact
// (as in Z. Ren et al., "Real-time Soft Shadows in Dynamic Scenes using Spherical Harmonic Exponentiation", 2006).
float lightPastSpheres(vec3 point, vec3 light, float angle) {
    float seen = 1.0;
    for (int index = 0; index < sphereCount && seen > 0.001; ++index)
        seen *= 1.0 - hiddenBySphere(point, light, angle, sphereAt(index));
    return seen;
}

// The same for the sky: the ambient occlusion that the spheres cause.
float skyPastSpheres(vec3 point, vec3 normal) {
    float seen = 1.0;
    for (int index = 0; index < sphereCount; ++index)
        seen *= 1.0 - skyHiddenBySphere(point, normal, sphereAt(index));
    return seen;
}
