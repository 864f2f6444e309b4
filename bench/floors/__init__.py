"""The kernels' speeds beside what the machine allows."""
