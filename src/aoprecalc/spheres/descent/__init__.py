"""Methods by descent: spheres that move until their silhouettes, and what they hold, are as wanted."""
