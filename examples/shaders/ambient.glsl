// Lighting with a baked ambient-occlusion texture (GLSL 1.30, GLSL ES 3.00 and later).
//
// How to bind the texture:
// - It holds numbers, not colours: upload it as a linear format of one channel (GL_R8, GL_R16F, ...), never as sRGB.
//   Where a loader has made an RGB picture of it, the value is the red channel (glTF's occlusionTexture says the same).
// - The first row of the picture is v = 1 for OBJ and PLY, while OpenGL's first row is v = 0: flip the rows on upload,
//   or sample at (u, 1 - v). For glTF the first row is v = 0: upload it as it is.
// - Filter linearly; sample no mip level from `first_unsafe_mip` of the report on, where neighbouring charts mix.

// Share of the light from all around that reaches the point, weighted by the cosine to its normal; 1 = open.
float ambientOcclusion(sampler2D bakedTexture, vec2 uv) {
    return texture(bakedTexture, uv).r;
}

// Light from all around that reaches the point. It belongs on ambient (image-based) light only.
vec3 ambientLight(float ao, vec3 ambient) {
    return ao * ambient;
}

// Stand-in for the shadow that a surface casts on itself: how well a light is seen, `cosine` from the normal.
// If the point sees out through a round opening about its normal, then ao = sin^2 of the opening's half angle;
// a light inside that cone is seen, one outside fades away
// (D. Chan, "Material Advances in Call of Duty: WWII", SIGGRAPH 2018 course, "micro-shadowing").
float seenThroughOpening(float ao, float cosine) {
    float inside = min(1.0, max(0.0, cosine) * inversesqrt(max(1e-6, 1.0 - ao)));
    return inside * inside;
}
