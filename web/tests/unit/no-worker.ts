/** In the place of the bundled worker. */
export default "";
