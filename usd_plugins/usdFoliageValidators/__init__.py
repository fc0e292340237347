"""UsdValidation validators of the usdFoliage schemas and of the layout of an asset."""
