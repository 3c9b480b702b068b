"""Links move bytes to and from programs and robots. Import each where it is needed."""
